"""From raw values to measurements: times, units, angles, ids."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from statistics import median

from wiclosure.errors import InputError
from wiclosure.formats.stamps import few_digits
from wiclosure.formats.text_cells import is_number
from wiclosure.pipeline.radio.readers.account import (
    ANCHOR,
    DEGREES,
    EMPTY,
    FAR,
    INVALID,
    REPEATED,
    SAME,
    UNKNOWN,
    UNREADABLE,
    Account,
)
from wiclosure.pipeline.radio.readers.quantities import LeftOut, bearing_of, measured_at_ns, range_of
from wiclosure.pipeline.radio.readers.rows import Row, Values
from wiclosure.pipeline.radio.readers.tag_names import TagNames, canonical, tag_text
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import WirelessLog, WirelessMeasurement

_MOST_BAD = 0.5  # of the rows: with more that cannot be read, the file is not what its mapping says
_SELDOM_M = 300.0  # of ranges whose unit nobody stated
_CLOSE_M = 1.0  # robots whose radios are never farther apart have no need of them
_COARSE = 0.5  # of the rows: with more whose times lost their digits, and which share few, the log has no times
_MOST_BEYOND = 0.05  # of the rows: angles of radians stay within a turn, those of degrees seldom do
_FALSE = {"", "0", "0.0", "false", "no", "f", "n"}


def interpret(
    rows: Iterable[Row], source: RadioSource, known: Collection[str] | None, where: str
) -> tuple[WirelessLog, Account]:
    """Measurements in order of time, each once, and what became of the rows.

    Args:
        rows: as read.
        source: what they mean.
        known: the robots that there are; None takes every name.
        where: the source, in messages.

    Raises:
        InputError: there are rows, but most cannot be read, or all lie beyond `max_range`; names the first.
    """
    account, names = Account(where), TagNames(source, known)
    for robot in (source.receiver, source.transmitter, *_mapped(source)):
        if robot is not None and known is not None and robot not in known:
            raise InputError(f"{where} names the robot {robot!r}, but there are {', '.join(known)}; name them alike")
    measurements: dict[WirelessMeasurement, str] = {}
    coarse: Counter[str] = Counter()
    for row in rows:
        account.rows += 1
        try:
            if row.problem is not None:
                raise LeftOut(UNREADABLE, row.problem)
            measurement = _measurement(row.values, source, names, account)
        except LeftOut as left:
            account.leave_out(left.reason, row.place, str(left))
        except (InputError, ValueError, TypeError) as error:
            account.leave_out(UNREADABLE, row.place, str(error))
        else:
            if measurement in measurements:
                account.leave_out(REPEATED, row.place, f"as {measurements[measurement]}")
            measurements.setdefault(measurement, row.place)
        if (text := str(row.values.get("stamp"))) and _is_coarse(text):
            coarse[text] += 1
    account.used = len(measurements)
    _refuse_lost_times(account, coarse)
    ranges_m = [m.range_m for m in measurements if m.range_m is not None]
    _refuse_nonsense(account, source, max(ranges_m, default=0.0))
    _doubt_unit(account, source, ranges_m)
    return WirelessLog() + WirelessLog(tuple(measurements)), account


def _mapped(source: RadioSource) -> Collection[str]:
    return source.robots.values() if isinstance(source.robots, dict) else ()


def _refuse_nonsense(account: Account, source: RadioSource, longest_m: float) -> None:
    bad = account.left_out[UNREADABLE]
    if bad and bad >= _MOST_BAD * account.rows:
        raise InputError(
            f"{account.where}: {bad} of {account.rows} rows cannot be read ({account.first[UNREADABLE]});"
            " check which field means what"
        )
    if account.left_out[DEGREES] > _MOST_BEYOND * account.rows:
        raise InputError(
            f"{account.where}: {account.left_out[DEGREES]} of {account.rows} rows have angles beyond a turn"
            f" ({account.first[DEGREES]}); they look like degrees: add angle_unit: deg"
        )
    near_limit = longest_m > source.max_range / 2  # a code for "nothing heard" stands apart from what was heard
    if account.left_out[FAR] > account.rows / 2 and (near_limit or not account.used):
        raise InputError(
            f"{account.where}: {account.left_out[FAR]} of {account.rows} ranges lie beyond {source.max_range:g} m"
            f" ({account.first[FAR]}); if they are millimetres or centimetres add unit: mm or unit: cm, else raise"
            " max_range"
        )


def _doubt_unit(account: Account, source: RadioSource, ranges_m: Sequence[float]) -> None:
    if ranges_m and "unit" not in source.model_fields_set and median(ranges_m) > _SELDOM_M:
        account.doubt(
            f"half of the ranges are longer than {median(ranges_m):.4g} m, which UWB does not reach; if they are"
            " centimetres add unit: cm, else state unit: m"
        )

    if ranges_m and max(ranges_m) < _CLOSE_M:
        account.doubt(
            f"all ranges are {max(ranges_m):.2g} m or shorter; check the unit ({source.unit}), and that no point"
            " stands between thousands"
        )


def _is_coarse(stamp: str) -> bool:
    return is_number(stamp) and few_digits(stamp) is not None


def _refuse_lost_times(account: Account, coarse: Counter[str]) -> None:
    """Spreadsheets write `1.7E+09`: then many rows share one time."""
    if coarse.total() > _COARSE * account.rows and coarse.total() > 2 * len(coarse):
        text, count = coarse.most_common(1)[0]
        raise InputError(
            f"{account.where}: the time {text} stands in {count} of {account.rows} rows: whoever wrote it kept too few"
            " digits; export the log again with all of them"
        )


def _measurement(values: Values, source: RadioSource, names: TagNames, account: Account) -> WirelessMeasurement:
    if _is_false(values.get("valid", True)):
        raise LeftOut(INVALID)
    receiver, transmitter = _robots(values, source, names, account)
    range_m, sigma_m = range_of(values, source)
    path, reach_m = bearing_of(values, source)
    if range_m is None and source.take != "bearing":
        range_m = reach_m
    if range_m is None and path is None:
        raise LeftOut(EMPTY)
    if range_m is not None and range_m > source.max_range:
        raise LeftOut(FAR, f"{range_m:g} m")
    arms = {canonical(tag): arm for tag, arm in source.lever_arms.items()}
    return WirelessMeasurement(
        stamp_ns=measured_at_ns(values, source, account),
        receiver=receiver,
        transmitter=transmitter,
        range_m=range_m,
        range_sigma_m=None if range_m is None else sigma_m,
        paths=() if path is None or source.take == "range" else (path,),
        aoa_frame=source.aoa_frame,
        lever_arm_receiver=arms.get(canonical(values.get("from", "")), (0.0, 0.0, 0.0)),
        lever_arm_transmitter=arms.get(canonical(values.get("to", "")), (0.0, 0.0, 0.0)),
    )


def _robots(values: Values, source: RadioSource, names: TagNames, account: Account) -> tuple[str, str]:
    robots: list[str] = []
    strangers: list[str] = []
    for key, given in (("from", source.receiver), ("to", source.transmitter)):
        tag = values.get(key)
        if given is not None:
            robots.append(given)
        elif tag is None or str(tag).strip() == "":
            role = "receiver" if key == "from" else "transmitter"
            raise LeftOut(UNREADABLE, f"nothing says who the {role} is; name its field as {key}, or give {role}")
        elif (robot := names.robot(tag)) is not None:
            robots.append(robot)
        else:
            strangers.append(tag_text(tag))
    if strangers:
        unknown = [tag for tag in strangers if not names.is_anchor(tag)]
        account.ids.update(unknown)
        raise LeftOut(UNKNOWN if unknown else ANCHOR)
    if robots[0] == robots[1]:
        raise LeftOut(SAME)
    return robots[0], robots[1]


def _is_false(raw: object) -> bool:
    return str(raw).strip().casefold() in _FALSE
