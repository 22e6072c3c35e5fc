"""One source of radio measurements, as a data set or a command line names it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from wiclosure.formats.name_pattern import NamePattern
from wiclosure.formats.radio.radio_units import AngleUnit, AzimuthZero, ElevationZero, LengthUnit, TimeUnit
from wiclosure.settings import Settings
from wiclosure.types import AoaFrame

RadioKind: TypeAlias = Literal["jsonl", "table", "lines", "topics", "wsr", "pyfg"]


def _text(value: object) -> object:
    """YAML makes numbers of ids and of columns' numbers; here they are names."""
    return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _texts(value: object) -> object:
    return {_text(key): entry for key, entry in value.items()} if isinstance(value, Mapping) else value


Name: TypeAlias = Annotated[str, BeforeValidator(_text), Field(min_length=1)]
Names: TypeAlias = Annotated[tuple[Name, ...], BeforeValidator(lambda v: (v,) if isinstance(v, str | int) else v)]
LeverArm: TypeAlias = tuple[float, float, float]


class RadioSource(Settings):
    """A radio log, and what its columns or fields mean.

    A *field* is the name of a table's column or its number (from 1), the name of a group of `pattern`, or the path of a
    field in a message, as `header.stamp` or `nodes[].dis` (each element of an array).
    """

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    path: Path | None = Field(None, description="file, or bag; without it `topic` is read from each robot's own bag")
    kind: RadioKind | None = Field(
        None, description="jsonl, table, lines, topics, wsr or pyfg; told from the file where it is not given"
    )
    preset: str | None = Field(
        None, description="name of a preset, or a YAML file of settings that these are laid over"
    )
    topic: str | None = Field(
        None,
        description="topic of a bag, or a family of them: `/uwb/n_{from}/n_{to}/range`, where the name holds the ids",
    )
    pattern: str | None = Field(
        None, description="regular expression that finds each measurement of a line; its groups are fields"
    )
    columns: Names = Field((), description="names of the columns of a table without header line")
    delimiter: str | None = Field(None, description="between the cells of a table; found where it is not given")

    stamp: Names = Field(
        (),
        description="field of the time, or two: seconds and nanoseconds, date and time; `received`: at the bag",
    )
    stamp_unit: TimeUnit = Field(
        "auto",
        description="s, ms, us, ns, 100us, 10us, 100ns since 1970, filetime (100 ns since 1601), dotnet (100 ns since"
        " the year 1); auto: by their size, else s; ISO 8601 dates",
    )
    time_offset: float = Field(
        0.0, description="seconds that are added to the log's stamps, before those of the robots"
    )
    from_: Name | None = Field(None, alias="from", description="field with the id of the tag that measured")
    to: Name | None = Field(None, description="field with the id of the tag that was measured")
    receiver: Name | None = Field(None, description="robot that measured, where no field says so")
    transmitter: Name | None = Field(None, description="robot that was measured, where no field says so")
    robots: Annotated[dict[str, str], BeforeValidator(_texts)] | Literal["by number"] | None = Field(
        None, description="robot of each id: `{7: alpha, 12: beta}`; `by number`: id 2 is the robot whose name ends so"
    )
    anchors: Names = Field((), description="ids that are known to be no robots; left out without a warning")

    range_: Names = Field((), alias="range", description="field of the range, or several; may be a family of columns")
    unit: LengthUnit = Field("m", description="of ranges, their sigma and positions: m, mm, cm, dm, km, ft or in")
    range_sigma: float | Name | None = Field(
        None, description="standard deviation of the ranges: metres, or a field in `unit`; 0.5 m where nothing says so"
    )
    range_variance: Name | None = Field(None, description="field of the variance, in `unit` squared")
    range_offset: float = Field(0.0, description="metres that are added to each range: the negative of a known bias")
    range_limits: tuple[float | Name, float | Name] | None = Field(
        None, description="least and greatest reading that counts: numbers, or fields, in `unit`"
    )
    max_range: float = Field(1000.0, gt=0, description="metres; readings beyond are left out and counted")
    valid: Name | None = Field(None, description="field that is true (or not 0) where the reading counts")

    azimuth: Name | None = Field(None, description="field of the azimuth at which the other was seen")
    elevation: Name | None = Field(None, description="field of the elevation")
    x: Name | None = Field(None, description="field of the other's position in the receiver's axes: forward")
    y: Name | None = Field(None, description="the same: left")
    z: Name | None = Field(None, description="the same: up")
    take: Literal["both", "range", "bearing"] = Field("both", description="of positions: both, range or bearing")
    angle_unit: AngleUnit = Field("rad", description="of angles and their sigma: rad or deg")
    clockwise: bool = Field(False, description="azimuth grows to the right, as a compass does")
    azimuth_zero: AzimuthZero = Field("forward", description="where azimuth is 0: forward (x), left (y), back or right")
    elevation_zero: ElevationZero = Field("horizontal", description="where elevation is 0: horizontal, or up (zenith)")
    bearing_sigma: float | Name = Field(
        0.1745, description="standard deviation of bearings: radians (default 10 degrees), or a field in `angle_unit`"
    )
    aoa_frame: AoaFrame = Field(
        "body", description="axes of the bearings: body (receiver's, at the stamp), odometry or world"
    )
    lever_arms: Annotated[dict[str, LeverArm], BeforeValidator(_texts)] = Field(
        {}, description="antenna of each id in its robot's body frame, `[x, y, z]` in metres"
    )
    stamps: Annotated[dict[str, float], BeforeValidator(_texts)] = Field(
        {}, description="time of each trial of a WSR-Toolbox file, seconds"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.path is None and self.topic is None:
            raise ValueError("a wireless source needs a path, or a topic of the robots' own bags")
        if (self.x is None) != (self.y is None):
            raise ValueError("x and y go together; give both")
        if len(self.stamp) > 2:
            raise ValueError("stamp takes one field, or two of seconds and nanoseconds")
        return self

    def of_bag(self, path: Path, robot: str) -> RadioSource:
        """The same for one robot's bag; it measured, where nothing in the messages or the topic's name says who did."""
        ids = NamePattern(self.topic or "").roles
        stated = self.from_ is not None or self.receiver is not None or "from" in ids
        return self.model_copy(update={"path": path, **({} if stated else {"receiver": robot})})

    def described(self) -> str:
        """Where it is, in messages."""
        return " ".join(str(part) for part in (self.path, self.topic) if part is not None)


def keys() -> dict[str, Any]:
    """Name as in a file, and field, of each setting."""
    return {field.alias or name: field for name, field in RadioSource.model_fields.items()}
