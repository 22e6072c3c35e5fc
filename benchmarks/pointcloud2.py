"""Decoding PointCloud2, against rosbags' deserialisation alone, in one run.

    python benchmarks/pointcloud2.py [--scans 40] [--repeat 5]

Two questions.  From memory: how much does the decoder add to `deserialize_cdr`, which only points into the message's
bytes?  From a bag: how much does `open_source` add to reading and deserialising with rosbags alone, and to reading
`x y z` into float64 by the simplest means, the least that a reader of scans can do?  Times are the processor's, so that
other work on the machine counts for less.  Peak memory is what Python and NumPy allocate beyond the message itself
(tracemalloc).  Clouds are synthetic, of the size and layout that the drivers of an HDL-64 and an OS1-128 write.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.sources.messages.pointcloud2 import PointCloud2Decoder, PointCloud2Message
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, serialize, typestore
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

STORE = typestore("cdr")
DATATYPE = {"f4": 7, "f8": 8, "u2": 4, "u4": 6, "u1": 2}


def cloud(height: int, width: int, fields: Mapping[str, tuple[str, int]], step: int, missing: float) -> bytes:
    """A serialised cloud; a share of its points is `missing` (NaN)."""
    rng = np.random.default_rng(0)
    offsets = [offset for _, offset in fields.values()]
    layout = np.dtype(
        {"names": list(fields), "formats": [f for f, _ in fields.values()], "offsets": offsets, "itemsize": step}
    )
    records = np.zeros(height * width, layout)
    for axis in "xyz":
        records[axis] = rng.normal(0, 20, len(records))
        records[axis][rng.random(len(records)) < missing / 3] = np.nan
    for name, (fmt, _) in fields.items():
        if name == "t":
            records[name] = np.linspace(0, 1e8, len(records))
        elif name in {"time", "timestamp"}:
            records[name] = np.linspace(0, 0.1, len(records)) + (1.7e9 if fmt == "f8" else 0)
    message: Any = encode_scan(Scan(1_700_000_000 * 10**9, np.zeros((1, 3))), STORE)
    field = STORE.types["sensor_msgs/msg/PointField"]
    message.fields = [field(name=n, offset=o, datatype=DATATYPE[f], count=1) for n, (f, o) in fields.items()]
    message.height, message.width, message.point_step, message.row_step = height, width, step, step * width
    message.data = records.view(np.uint8)
    return bytes(serialize(STORE, "cdr", message, POINT_CLOUD_TYPE))


XYZI = {"x": ("f4", 0), "y": ("f4", 4), "z": ("f4", 8), "intensity": ("f4", 12)}
CLOUDS: Mapping[str, Callable[[], bytes]] = {
    "HDL-64, xyz+intensity, 16 B": lambda: cloud(1, 122_000, XYZI, 16, 0.0),
    "HDL-64, + ring + time, 22 B": lambda: cloud(1, 122_000, XYZI | {"ring": ("u2", 16), "time": ("f4", 18)}, 22, 0.0),
    "HDL-64, + timestamp f8, 32 B": lambda: cloud(1, 122_000, XYZI | {"timestamp": ("f8", 24)}, 32, 0.0),
    "OS1-128, organised, 30 % NaN, 48 B": lambda: cloud(128, 1024, XYZI | {"t": ("u4", 20)}, 48, 0.3),
}


def fastest(run: Callable[[], object], repeat: int) -> float:
    """Seconds of the fastest of several runs: the others measure what else the machine does."""
    seconds = []
    for _ in range(repeat):
        started = time.process_time()
        run()
        seconds.append(time.process_time() - started)
    return min(seconds)


def peak_mb(run: Callable[[], object]) -> float:
    tracemalloc.start()
    run()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 1e6


def from_memory(repeat: int) -> None:
    print(f"{'one cloud in memory':<36}{'MB':>6}{'rosbags ms':>12}{'+ decode ms':>13}{'MB/s':>8}{'peak MB':>9}")
    for name, make in CLOUDS.items():
        raw = make()
        decoder = PointCloud2Decoder()

        def deserialise(raw: bytes = raw) -> PointCloud2Message:
            return cast("PointCloud2Message", STORE.deserialize_cdr(raw, POINT_CLOUD_TYPE))

        def both(decoder: PointCloud2Decoder = decoder, run: Callable[[], PointCloud2Message] = deserialise) -> Scan:
            return decoder.decode(run())

        alone, whole = fastest(deserialise, 20 * repeat), fastest(both, 20 * repeat)
        rate = len(raw) / 1e6 / whole
        print(
            f"{name:<36}{len(raw) / 1e6:>6.2f}{alone * 1e3:>12.3f}{whole * 1e3:>13.3f}{rate:>8.0f}{peak_mb(both):>9.1f}"
        )


def serialised(path: Path) -> Iterator[PointCloud2Message]:
    """The messages as rosbags alone gives them: their points still bytes."""
    store = typestore("ros1" if path.suffix == ".bag" else "cdr")
    deserialise = store.deserialize_ros1 if path.suffix == ".bag" else store.deserialize_cdr
    with Reader1(path) if path.suffix == ".bag" else Reader2(path) as reader:
        for _, _, raw in reader.messages():
            yield cast("PointCloud2Message", deserialise(raw, POINT_CLOUD_TYPE))


def plain_points(path: Path) -> Iterator[NDArray[np.float64]]:
    """The least that any odometry needs: x y z as float64, unchecked, without times."""
    for message in serialised(path):
        records = np.frombuffer(message.data, np.dtype([(field.name, "<f4") for field in message.fields]))
        points = np.empty((len(records), 3))
        for column, axis in enumerate("xyz"):
            points[:, column] = records[axis]
        yield points


READERS: Mapping[str, Callable[[Path], Iterable[object]]] = {
    "rosbags": serialised,
    "rosbags + x y z": plain_points,
    "open_source": open_source,
}


def exhaust_file(read: Callable[[Path], Iterable[object]], path: Path) -> None:
    for _ in read(path):
        pass


def from_bags(count: int, repeat: int) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 20, (122_000, 3))
    intensity = np.zeros(len(points), np.float32)
    times = np.linspace(0, 0.1, len(points))
    scans = [Scan((17 * 10**9 + number) * 10**8, points, times, intensity) for number in range(count)]
    title = f"{count} clouds in a bag, MB/s"
    print(f"\n{title:<28}" + "".join(f"{name:>17}" for name in READERS) + f"{'share':>7}{'of x y z':>10}{'peak MB':>9}")
    with tempfile.TemporaryDirectory() as folder:
        paths = {"ROS 1": Path(folder, "a.bag"), "ROS 2 mcap": Path(folder, "b"), "ROS 2 sqlite3": Path(folder, "c")}
        write_ros1_bag(paths["ROS 1"], scans)
        write_ros2_bag(paths["ROS 2 mcap"], scans, storage="mcap")
        write_ros2_bag(paths["ROS 2 sqlite3"], scans, storage="sqlite3")
        megabytes = count * len(points) * 20 / 1e6
        for name, path in paths.items():
            fastest_s = dict.fromkeys(READERS, math.inf)
            for _ in range(repeat):  # taking turns
                for reader, read in READERS.items():
                    fastest_s[reader] = min(fastest_s[reader], fastest(partial(exhaust_file, read, path), 1))
            alone, least, ours = (megabytes / seconds for seconds in fastest_s.values())
            peak = peak_mb(partial(exhaust_file, open_source, path))
            rates = "".join(f"{rate:>17.0f}" for rate in (alone, least, ours))
            print(f"{name:<28}{rates}{ours / alone:>7.0%}{ours / least:>10.0%}{peak:>9.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--repeat", type=int, default=5)
    args = parser.parse_args()
    from_memory(args.repeat)
    from_bags(args.scans, args.repeat)


if __name__ == "__main__":
    main()
