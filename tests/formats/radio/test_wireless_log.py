"""Wireless logs: round trip, exact stamps, and one clear line for anything that is wrong."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

GOOD = (
    '{"type":"wireless","stamp":12.3,"receiver":"alpha","transmitter":"beta","range":23.41,"range_sigma":0.5,'
    '"aoa_frame":"body","paths":[{"azimuth":0.31,"elevation":null,"sigma":0.1745,"weight":0.62}]}'
)

stamps = st.integers(-(7 * 10**18), 7 * 10**18)
finite = st.floats(-100, 100)
positive = st.floats(1e-6, 1e6)
names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=8)
paths = st.builds(
    AoaPath,
    azimuth=st.floats(-6.2, 6.2),
    sigma=st.floats(1e-4, 3),
    weight=st.floats(0, 10),
    elevation=st.none() | st.floats(-1.57, 1.57),
)
arms = st.just((0.0, 0.0, 0.0)) | st.tuples(finite, finite, finite)


@st.composite
def measurements(draw: st.DrawFn) -> WirelessMeasurement:
    receiver, transmitter = draw(st.lists(names, min_size=2, max_size=2, unique=True))
    some_paths = tuple(draw(st.lists(paths, max_size=4)))
    with_range = draw(st.booleans()) or not some_paths
    return WirelessMeasurement(
        stamp_ns=draw(stamps),
        receiver=receiver,
        transmitter=transmitter,
        range_m=draw(st.floats(0, 1e6)) if with_range else None,
        range_sigma_m=draw(positive) if with_range else None,
        paths=some_paths,
        aoa_frame=draw(st.sampled_from(["body", "odometry", "world"])),
        transmitter_stamp_ns=draw(st.none() | stamps),
        lever_arm_receiver=draw(arms),
        lever_arm_transmitter=draw(arms),
    )


headings = st.builds(Heading, stamp_ns=stamps, robot=names, heading=st.floats(-6.2, 6.2), sigma=positive)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(measurements(), max_size=5), st.lists(headings, max_size=3))
def test_what_is_written_is_read_back_exactly(
    tmp_path: Path, some: list[WirelessMeasurement], more: list[Heading]
) -> None:
    log = WirelessLog(tuple(some), tuple(more)) + WirelessLog()  # in order of time
    write_wireless_log(tmp_path / "w.jsonl", log)
    assert read_wireless_log(tmp_path / "w.jsonl") == log


def test_stamps_keep_every_nanosecond(tmp_path: Path) -> None:
    file = tmp_path / "w.jsonl"
    file.write_text(GOOD.replace('"stamp":12.3', '"stamp":1700000000.123456789') + "\n")
    assert read_wireless_log(file).measurements[0].stamp_ns == 1700000000123456789


def test_defaults_blank_lines_and_any_order(tmp_path: Path) -> None:
    file = tmp_path / "w.jsonl"
    file.write_text(
        '\ufeff{"type":"wireless","stamp":2,"receiver":"b","transmitter":"a","range":3}\n\n'
        '{"type":"wireless","stamp":1,"receiver":"a","transmitter":"b","range":null,'
        '"paths":[{"azimuth":1,"sigma":0.1}]}\r\n'
        '{"type":"heading","stamp":0,"robot":"a","heading":1,"sigma":0.1}',
        encoding="utf-8",
    )
    log = read_wireless_log(file)
    assert [m.stamp_ns for m in log.measurements] == [1_000_000_000, 2_000_000_000]
    assert log.measurements[0].paths == (AoaPath(1.0, 0.1),)
    assert log.measurements[1].range_sigma_m == 0.5
    assert log.headings == (Heading(0, "a", 1.0, 0.1),)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("{", ""), "not valid JSON"),
        (('"type":"wireless"', '"type":"wifi"'), "wireless"),
        (('"type":"wireless",', ""), "type"),
        (('"range_sigma"', '"range_sigmas"'), "did you mean range_sigma?"),
        (('"azimuth"', '"azimut"'), '"azimuth"'),
        (('"receiver":"alpha",', ""), '"receiver"'),
        (('"receiver":"alpha"', '"receiver":"beta"'), "to itself"),
        (('"receiver":"alpha"', '"receiver":7'), "expected a name"),
        (("23.41", "NaN"), "finite"),
        (("23.41", "-1"), ">= 0"),
        (("23.41", "1e999"), "finite"),
        (("23.41", "true"), "expected a number"),
        (("23.41", '"23.41"'), "expected a number"),
        (('"range_sigma":0.5', '"range_sigma":0'), "> 0"),
        (("0.1745", "0"), "sigma"),
        (("0.62", "-0.1"), "weight"),
        (('"elevation":null', '"elevation":45'), "elevation"),
        (("12.3", "1700000000123456789"), "seconds"),
        (('"body"', '"map"'), "aoa_frame"),
        (('"paths":[', '"paths":[3,'), "a path is 3"),
        (('"aoa_frame":"body"', '"lever_arm_receiver":[1,2]'), "[x, y, z]"),
    ],
)
def test_a_bad_record_is_one_sentence_with_file_and_line(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    file = tmp_path / "w.jsonl"
    file.write_text(GOOD + "\n" + GOOD.replace(*change, 1) + "\n")
    with pytest.raises(InputError) as caught:
        read_wireless_log(file)
    message = str(caught.value)
    assert str(file) in message
    assert "line 2" in message
    assert says in message
    assert "\n" not in message


def test_a_missing_file_and_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_wireless_log(tmp_path / "nowhere.jsonl")
    with pytest.raises(OutputError, match="nowhere"):
        write_wireless_log(tmp_path / "nowhere" / "w.jsonl", WirelessLog())


def test_angles_in_degrees_are_warned_of_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "w.jsonl"
    file.write_text("\n".join([GOOD] + [GOOD.replace("0.31", "31.0")] * 3))
    with caplog.at_level(logging.WARNING):
        assert len(read_wireless_log(file).measurements) == 4
    (warning,) = caplog.records
    assert "line 2" in warning.getMessage()
    assert "degrees" in warning.getMessage()
    assert "3 lines" in warning.getMessage()


def test_hundreds_of_paths_are_read(tmp_path: Path) -> None:
    file = tmp_path / "w.jsonl"
    record = json.loads(GOOD)
    record["paths"] *= 500
    file.write_text(json.dumps(record))
    assert len(read_wireless_log(file).measurements[0].paths) == 500


def read_or_refuse(file: Path) -> str:
    """Nothing but a log or an InputError may come out; the error's sentence, or nothing."""
    try:
        assert isinstance(read_wireless_log(file), WirelessLog)
    except InputError as error:
        return str(error)
    return str(file)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just("wireless"),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=5) | st.sampled_from(["azimuth", "sigma"]), inner, max_size=3)
    ),
    max_leaves=6,
)
records = st.fixed_dictionaries(
    {},
    optional=dict.fromkeys(json.loads(GOOD), json_values) | {"type": st.just("wireless"), "receiver": st.just("a")},
).map(lambda record: json.dumps(record).encode())


@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(records | st.binary(max_size=60), max_size=3))
def test_any_bytes_give_a_log_or_an_input_error(tmp_path: Path, lines: list[bytes]) -> None:
    file = tmp_path / "fuzz.jsonl"
    file.write_bytes(b"\n".join(lines))
    assert str(file) in read_or_refuse(file)


@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(GOOD) - 1), st.binary(max_size=3), st.integers(0, 4))
def test_a_damaged_line_gives_a_log_or_an_input_error(tmp_path: Path, at: int, patch: bytes, cut: int) -> None:
    file = tmp_path / "fuzz.jsonl"
    file.write_bytes(GOOD.encode()[:at] + patch + GOOD.encode()[at + cut :])
    assert str(file) in read_or_refuse(file)


@pytest.mark.parametrize("number", ["1e999999999999", "-1e-999999999999", "9" * 5000, "0." + "1" * 5000])
def test_monstrous_numbers_give_a_log_or_an_input_error(tmp_path: Path, number: str) -> None:
    file = tmp_path / "w.jsonl"
    for field in ("12.3", "23.41"):
        file.write_text(GOOD.replace(field, number))
        assert str(file) in read_or_refuse(file)
    file.write_text("[" * 100_000)
    with pytest.raises(InputError, match="nested deeper than 64"):
        read_wireless_log(file)
