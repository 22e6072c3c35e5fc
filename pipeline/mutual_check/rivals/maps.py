"""Merged maps of two robots that fit as well otherwise: closures of places that look alike agree, and may all be false.

A hall that looks the same turned by half a turn shows each scan twice.  No registration of a closure tells that, as
the other place lies far off, and where all closures that were found are of the same wrong half turn, none contradicts
them.  So the map of one robot is laid over that of the other in all ways.  Where another way fits, keyframes that it
brings together are registered, and judged as the accepted ones are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from wiclosure import se3
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.odds import in_words
from wiclosure.pipeline.mutual_check.pair_check import Pair
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.rivals.other_ways import MergedPair, OtherWay, Register
from wiclosure.pipeline.mutual_check.rivals.sets import MAY_BE_WRONG, RivalSets, told_apart
from wiclosure.types import (
    Closure,
    Float32Array,
    Stage,
    Trajectory,
    WirelessLog,
    survivors,
)

_OVERDETERMINED = 20  # measurements: about as many as there are known errors to choose from


@dataclass(frozen=True, eq=False)
class RivalMap:
    """Another way in which two robots may lie to each other, that their scans allow, and their radio does not refute.

    Args:
        pair: the robots.
        moved_m: how far the middle of the second one's path would lie from where it is.
        turned_rad: by how much that robot would be turned.
        agreeing: registrations that agree with it, of `tried`.
        tried: keyframes that it brings together.
        radio: what the robots measured of each other tells of the two, as a clause; empty where nothing was measured.
    """

    pair: Pair
    moved_m: float
    turned_rad: float
    agreeing: int
    tried: int
    radio: str = ""

    @property
    def sentence(self) -> str:
        """For the user."""
        first, second = self.pair
        return (
            f"{first} and {second}: {MAY_BE_WRONG}: the scans fit as well if {second} is put {self.moved_m:.1f} m from"
            f" there and turned by {np.degrees(abs(self.turned_rad)):.0f} degrees ({self.agreeing} of {self.tried}"
            f" registrations agree), as where places look alike; {self.radio or 'nothing tells which is true'}"
        )


def rival_maps(
    merged: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    clouds: Mapping[str, Sequence[Float32Array]],
    odometry: Mapping[str, Trajectory],
    wireless: WirelessLog,
    trusted: Collection[Pair],
    config: Config,
    register: Register,
) -> list[RivalMap]:
    """Of robots that accepted closures join, one at most for each two.

    Args:
        merged: keyframes of all robots, each in the frame of its map.
        closures: of the run.
        clouds: of all keyframes, `(N, 3)` in the body's axes, by robot.
        odometry: keyframes of all robots, each in a frame of its own.
        wireless: the whole log, as it was read.
        trusted: pairs whose radio is certain of an alignment that the map agrees with; they are not looked at where
            they measured so much that no known error makes the log fit a wrong alignment by chance.
        config: of the run.
        register: registers keyframes that are brought together.
    """
    found: list[RivalMap | None] = []
    measured = Counter(frozenset((m.receiver, m.transmitter)) for m in wireless.measurements)
    overdetermined = {pair for pair in map(frozenset, trusted) if measured[pair] >= _OVERDETERMINED}
    accepted: dict[Pair, list[Closure]] = {}
    for closure in survivors(closures, Stage.ESTIMATE):
        accepted.setdefault((closure.query.robot, closure.match.robot), []).append(closure)
    for pair in _joining({pair: len(of) for pair, of in accepted.items()}):
        if frozenset(pair) not in overdetermined:
            radio = PairRadio.of(pair, odometry, wireless, config.filter.alignment)
            of_pair = MergedPair.of(pair, merged, clouds, config)
            found.append(_least_decided(list(of_pair.other_ways(register)), accepted[pair], radio, config))
    return [one for one in found if one is not None]


def _joining(closures: Mapping[Pair, int]) -> list[Pair]:
    """Of pairs by how many closures they have, those that hold the map together: a tree, of the pairs with most.

    Others agree with these.  If places look alike, one of these is wrong as well.
    """
    pairs = [pair for pair in closures if pair[0] != pair[1]]
    if not pairs:
        return []
    number = {robot: n for n, robot in enumerate(dict.fromkeys(robot for pair in pairs for robot in pair))}
    rows, columns = np.array([[number[robot] for robot in pair] for pair in pairs]).T
    graph = coo_array(([1.0 / closures[pair] for pair in pairs], (rows, columns)), (len(number),) * 2)
    tree = minimum_spanning_tree(graph.tocsr())
    return [pair for pair, row, column in zip(pairs, rows, columns, strict=True) if tree[row, column]]


def _least_decided(
    rivals: Sequence[OtherWay], accepted: Sequence[Closure], radio: PairRadio, config: Config
) -> RivalMap | None:
    """Of all that fit as well as the map: none, where what the robots measured speaks for the map against all."""
    if not rivals:
        return None
    ends = np.cumsum([0, len(accepted), *(len(rival.agreeing) for rival in rivals)])
    sets = [np.arange(start, end) for start, end in pairwise(ends.tolist())]
    shown, radio_tells = max(rivals, key=lambda rival: rival.score), ""
    if radio.measurements:
        closures = [*accepted, *(closure for rival in rivals for closure in rival.agreeing)]
        told = told_apart(sets, closures, range(len(closures)), radio, config.mutual_check)
        likeliest = next(n for n, rows in enumerate(sets) if told.kept == frozenset(rows.tolist()))
        if told.decides and likeliest == 0 and not told.contested:
            return None
        shown, radio_tells = rivals[likeliest - 1] if likeliest else shown, _radio_tells(told, likeliest == 0)
    turned_rad = float(se3.yaw(shown.T))
    return RivalMap(radio.pair, shown.moved_m, turned_rad, len(shown.agreeing), len(shown.tried), radio_tells)


def _radio_tells(told: RivalSets, for_map: bool) -> str:
    """Of a map and its rivals, where that leaves a doubt."""
    if not told.decides:
        return "nothing tells which is true, nor do the measurements of each other"
    if for_map:
        return f"the log speaks for the map as it is, yet would fit the other way better if {told.contested}"
    return f"what the robots measured of each other speaks for the other way ({in_words(told.log_odds)})"
