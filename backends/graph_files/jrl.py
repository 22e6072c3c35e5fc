"""JSON Robot Logs (JRL): multi-robot graphs with the labels of their loops, as COSMO-Bench has them.

McGann et al., the format's description in the repository `DanMcGann/jrl`: keys are GTSAM's symbols, quaternions are
w x y z, covariances are full matrices row by row with rotation first (planar: x y theta).  The description and the
repository's own reader differ on values and labels; both forms are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wiclosure.backends.graph_files.open import read_bytes
from wiclosure.backends.graph_files.records import (
    Edge,
    FileRecords,
    Remarks,
    Vertex,
    from_planar,
    from_quaternions,
    lifted_information,
    require_key,
)
from wiclosure.errors import InputError
from wiclosure.formats.structured_text import parse_json
from wiclosure.types import FloatArray

Json = Any  # what a file may hold
RELATIVE_POSES = ("BetweenFactorPose2", "BetweenFactorPose3")
PRIORS = ("PriorFactorPose2", "PriorFactorPose3")
WXYZ_TO_XYZW = (1, 2, 3, 0)


def read_robot_log(path: Path, name: str, remarks: Remarks) -> FileRecords:
    """Poses and relative poses of a robot log; ranges, bearings and landmarks are counted and left out.

    A prior of a pose is its first guess where the log has no other.

    Raises:
        InputError: the file cannot be read, or is no robot log.
    """
    log = _loaded(path)
    records = FileRecords(path, name, is_robot_log=True)
    records.title = str(log.get("name", name))
    with _as_described(str(path)):
        guesses = list(_guesses(path, log.get("initialization") or {}, records))
        priors = _add_measurements(records, log)
    records.vertices += (priors | {vertex.key: vertex for vertex in guesses}).values()
    return records


@contextmanager
def _as_described(place: str) -> Iterator[None]:
    """Names what is not as the description of the format says."""
    try:
        yield
    except KeyError as error:
        raise InputError(f"{place}: {error} is missing; a JSON Robot Log has it, by its description") from error
    except (TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise InputError(
            f"{place}: {str(error)[:100]}; a JSON Robot Log has it otherwise, by its description"
        ) from error


def _add_measurements(records: FileRecords, log: dict[str, Json]) -> dict[int, Vertex]:
    """Adds all relative poses with their labels; returns priors of poses by key."""
    uncertain, false = (_labels(records.path, log, word) for word in ("potential_outlier_factors", "outlier_factors"))
    priors: dict[int, Vertex] = {}
    records.planar = True
    for factor, measurement in _measurements(log["measurements"]):
        place = "{}, robot {}, entry {}, measurement {}".format(records.path, *factor)
        with _as_described(place):
            kind = str(measurement["type"])
            planar = kind.endswith("Pose2")
            if kind in RELATIVE_POSES:
                records.planar &= planar
                records.edges.append(_labelled(_edge(place, measurement, planar=planar), factor, uncertain, false))
            elif kind in PRIORS:
                vertex = _vertex(place, measurement["prior"], measurement["key"], planar=planar)
                priors.setdefault(vertex.key, vertex)
            else:
                records.ignored[kind[:40]] += 1
    return priors


def _loaded(path: Path) -> dict[str, Json]:
    content = read_bytes(path)
    try:
        log = _from_cbor(path, content) if ".cbor" in path.suffixes else parse_json(content)
    except InputError as error:
        raise InputError(f"{path}: {error}; the file is cut?") from error
    if not isinstance(log, dict) or not isinstance(log.get("measurements"), dict):
        raise InputError(f"{path} is no JSON Robot Log: it has no measurements by robot")
    return log


def _from_cbor(path: Path, content: bytes) -> Json:
    try:
        import cbor2
    except ImportError as error:
        raise InputError(f"{path}: reading CBOR needs the package cbor2 (pip install wiclosure[cbor])") from error
    try:
        return cbor2.loads(content)
    except Exception as error:  # its own kinds, and those of values that cannot be made
        raise InputError(f"no CBOR ({' '.join(str(error).split())[:100]})") from error


def _labels(path: Path, log: dict[str, Json], word: str) -> set[tuple[str, int, int]] | None:
    """Factors by robot, entry and place in the entry; None where the file has no such list.

    Raises:
        InputError: the list names no robots, as the description has it, and there are several.
    """
    listed, robots = log.get(word), list(log["measurements"])
    if listed is None:
        return None
    if isinstance(listed, list):
        if len(robots) > 1 and listed:
            raise InputError(f"{path}: {word} names no robots, and there are {len(robots)}; expected lists by robot")
        listed = dict.fromkeys(robots, listed)
    return {(robot, int(entry), int(n)) for robot, pairs in listed.items() for entry, n in pairs or ()}


def _measurements(robots: dict[str, Json]) -> Iterator[tuple[tuple[str, int, int], Json]]:
    for robot, entries in robots.items():
        for entry, content in enumerate(entries or ()):
            for n, measurement in enumerate(content.get("measurements") or ()):
                yield (robot, entry, n), measurement


def _guesses(path: Path, values: dict[str, Json], records: FileRecords) -> Iterator[Vertex]:
    for robot, of_robot in values.items():
        place = f"{path}, initialization of {robot}"
        for key, value in _keyed(of_robot or (), place):
            with _as_described(place):
                if value["type"] not in ("Pose2", "Pose3"):
                    records.ignored[value["type"]] += 1
                    continue
                vertex = _vertex(place, value, key, planar=value["type"] == "Pose2")
            yield vertex


def _keyed(values: Json, place: str) -> list[tuple[Json, Json]]:
    """Values with their keys: a list in which each has its own, or, as the description has it, an object by key."""
    with _as_described(place):
        return list(values.items()) if isinstance(values, dict) else [(value["key"], value) for value in values]


def _vertex(place: str, value: Json, key: Json, *, planar: bool) -> Vertex:
    T, _ = _pose(value, planar=planar)
    return Vertex(require_key(int(key), place), place, T)


def _edge(place: str, measurement: Json, *, planar: bool) -> Edge:
    T, defect = _pose(measurement["measurement"], planar=planar)
    first, second = (require_key(int(measurement[word]), place) for word in ("key1", "key2"))
    return Edge(first, second, place, T, _information(measurement["covariance"], planar=planar), defect)


def _pose(value: Json, *, planar: bool) -> tuple[FloatArray, str]:
    if planar:
        poses, defects = from_planar(np.array([[value["x"], value["y"], value["theta"]]], float))
    else:
        quaternion = [value["rotation"][n] for n in WXYZ_TO_XYZW]
        poses, defects = from_quaternions(np.array([[*value["translation"], *quaternion]], float).reshape(1, 7))
    return poses[0], defects[0]


def _information(covariance: Json, *, planar: bool) -> FloatArray:
    """`(6, 6)`, rotation first; not finite where there is no inverse."""
    size = 3 if planar else 6
    stated = np.array(covariance, float).reshape(size, size)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest have no inverse, either
            information = np.linalg.inv(0.5 * (stated + stated.T))
    except np.linalg.LinAlgError:
        information = np.full((size, size), np.nan)
    return lifted_information(information[None])[0] if planar else information


def _labelled(
    edge: Edge,
    factor: tuple[str, int, int],
    uncertain: set[tuple[str, int, int]] | None,
    false: set[tuple[str, int, int]] | None,
) -> Edge:
    return replace(
        edge,
        factor=factor,
        may_be_false=None if uncertain is None else factor in uncertain,
        is_false=None if false is None else factor in false,
    )
