"""Every kind of radio log without bags: tables, lines, factor graphs, WSR output, JSON Lines."""

from __future__ import annotations

import csv
import json
import logging
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.pipeline.radio.read import RadioReading, read_radio
from wiclosure.pipeline.radio.words import sources_of_words
from wiclosure.types import AoaPath, WirelessLog, WirelessMeasurement


def read(word: str, known: list[str] | None = None) -> RadioReading:
    (source,) = sources_of_words([word])
    return read_radio(source, known)


def written(folder: Path, text: str, name: str = "uwb.csv") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


# --------------------------------------------------------------------------------------------------------------- tables
def test_millimetres_milliseconds_and_tag_ids(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        "time_ms,tag,anchor,distance_mm\n1700000000123.456789,7,12,20534\n1700000000200,12,7.0,20600\n1700000000300,7,3,1\n",
    )
    reading = read(f"{file},robots.7=alpha,robots.12=beta", ["alpha", "beta"])
    first, second = reading.log.measurements
    assert (first.stamp_ns, first.receiver, first.transmitter) == (1_700_000_000_123_456_789, "alpha", "beta")
    assert (first.range_m, second.range_m, second.receiver) == (20.534, 20.6, "beta")
    assert reading.account is not None
    assert reading.account.ids == {"3": 1}
    assert "3 (1); map them with robots: {3: NAME}" in reading.account.sentences()[0]


def test_anchors_are_left_out_in_peace(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = written(tmp_path, "t,from,to,range\n1,alpha,beta,2\n1,alpha,0,3\n")
    with caplog.at_level(logging.WARNING, "wiclosure"):
        assert len(read(f"{file},anchors=0", ["alpha", "beta"]).log.measurements) == 1
    assert not caplog.records


def test_columns_by_number_without_header(tmp_path: Path) -> None:
    file = written(tmp_path, "5.5 a b 3.25\n6.5 b a 4\n", "uwb.txt")
    log = read(f"{file},stamp=1,from=2,to=3,range=4,range_sigma=0.1").log
    assert [(m.stamp_ns, m.receiver, m.range_m, m.range_sigma_m) for m in log.measurements] == [
        (5_500_000_000, "a", 3.25, 0.1),
        (6_500_000_000, "b", 4.0, 0.1),
    ]


def test_names_for_columns_and_two_of_time(tmp_path: Path) -> None:
    file = written(tmp_path, "1700000000;5;7,5\n1700000001;7;8,5\n")
    (source,) = sources_of_words([str(file)])
    source = source.model_copy(
        update={"columns": ("s", "n", "d"), "stamp": ("s", "n"), "range_": ("d",), "receiver": "a", "transmitter": "b"}
    )
    log = read_radio(source).log
    assert [(m.stamp_ns, m.range_m) for m in log.measurements] == [
        (1_700_000_000 * 10**9 + 5, 7.5),
        (1_700_000_001 * 10**9 + 7, 8.5),
    ]


def test_bearings_in_degrees_clockwise_from_the_left(tmp_path: Path) -> None:
    file = written(tmp_path, "t,a,b,az,el,s\n0,x,y,90,80,5\n")
    word = f"{file},from=a,to=b,azimuth=az,elevation=el,bearing_sigma=s,angle_unit=deg,clockwise=true"
    (m,) = read(f"{word},azimuth_zero=left,elevation_zero=up,aoa_frame=odometry").log.measurements
    (path,) = m.paths
    assert (path.azimuth, path.elevation) == pytest.approx((0.0, math.radians(10)))
    assert path.sigma == pytest.approx(math.radians(5))
    assert (m.aoa_frame, m.range_m) == ("odometry", None)


def test_degrees_without_their_unit_are_refused_with_the_key(tmp_path: Path) -> None:
    rows = "".join(f"{i},x,y,{i * 9 - 180}\n" for i in range(40))
    with pytest.raises(InputError, match="add angle_unit: deg"):
        read(str(written(tmp_path, "t,from,to,azimuth\n" + rows)))


def test_positions_are_ranges_and_bearings(tmp_path: Path) -> None:
    file = written(tmp_path, "t,from,to,px,py,pz\n0,a,b,0,3000,4000\n")
    (m,) = read(f"{file},x=px,y=py,z=pz,unit=mm").log.measurements
    assert m.range_m == 5.0
    assert (m.paths[0].azimuth, m.paths[0].elevation) == pytest.approx((math.pi / 2, math.atan2(4, 3)))
    (only,) = read(f"{file},x=px,y=py,z=pz,unit=mm,take=bearing").log.measurements
    assert only.range_m is None


def test_real_ranges_of_many_antennas_are_near_the_truth(data_dir: Path) -> None:
    file = data_dir / "uwb_ranges" / "08" / "08_base-1_targ-2_win-1_step-1.csv"
    log = read(f"{file},preset=murp,receiver=r1,transmitter=r2").log
    with file.open() as table:
        rows = list(csv.DictReader(table))
    true = [float(row[f"{i}_{j}_t"]) for row in rows for i in range(1, 7) for j in range(1, 7)]
    assert len(log.measurements) == len(true) == 36 * len(rows)
    error = np.array([m.range_m for m in log.measurements], float) - true
    assert 0 < np.median(error) < 0.3  # UWB ranges too long rather than too short


def test_miluv_is_known_by_its_columns(tmp_path: Path) -> None:
    header = "range,bias,from_id,to_id,tx1,range_raw,timestamp\n"
    file = written(
        tmp_path, header + "3.5,0,10,21,0,3.6,1700000000.25\n3.5,0,10,11,0,3.6,1700000000.5\n9,0,10,1,0,9,2\n"
    )
    reading = read(str(file))
    (m,) = reading.log.measurements
    assert (m.receiver, m.transmitter, m.range_m) == ("ifo001", "ifo002", 3.5)
    assert m.lever_arm_receiver == (0.13189, -0.17245, -0.05249)
    assert reading.account is not None
    assert (reading.account.left_out["same"], reading.account.left_out["unknown"]) == (1, 1)


def test_bad_rows_are_counted_with_the_first_of_each_kind(tmp_path: Path) -> None:
    good = "".join(f"{i},a,b,{i}.5\n" for i in range(1, 30))
    bad = "x,a,b,2\n31,a,b,\n32,a,b,0\n33,a,b,-1\n34,a,b,nan\n35,a\n36,a,b,2000\n1,a,b,1.5\n5,a,a,3\n37,a,b,q\n"
    account = read(str(written(tmp_path, "t,from,to,range\n" + good + bad))).account
    assert account is not None
    assert account.used == 29
    assert account.left_out == {"unreadable": 3, "empty": 4, "far": 1, "repeated": 1, "same": 1}
    said = " ".join(account.sentences())
    assert "3 of 39 readings could not be read (first: line 31: 'x' is no time)" in said
    assert "1 of 39 readings repeat another (first: line 38: as line 2)" in said


@pytest.mark.parametrize(
    ("text", "word", "says"),
    [
        ("time,x\n1,2\n", "", "no column of ranges is known; name it with range:"),
        ("a,range\n1,2\n", "", "no column of times is known"),
        ("t,range\n1,2\n", "", "nothing says who the receiver is"),
        ("t,from,to,range\n1,a,b,2\n", ",range=dist", "no column 'dist'"),
        ("t,from,to,range\n1,a,b,20534\n2,a,b,20600\n", "", "millimetres or centimetres add unit: mm or unit: cm"),
        ("t,from,to,range\n" + 5 * "1.7E+09,a,b,3\n", "", "the time 1.7E+09 stands in 5 of 5 rows"),
        ("t,from,to,range\n" + 5 * "1.70000e9,a,b,3\n", "", "export the log again with all of them"),
        ("t,from,to,range\n1,a,b,2\n", ",robots.a=gamma", "names the robot 'gamma'"),
        ("t,from,to,range\nx,a,b,2\n", "", "1 of 1 rows cannot be read"),
        ("", "", "holds no rows"),
    ],
)
def test_what_cannot_be_read_is_one_sentence_with_the_way_out(tmp_path: Path, text: str, word: str, says: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read(f"{file}{word}", ["a", "b"])
    assert says in str(caught.value)
    assert str(file) in str(caught.value)


def test_robots_by_their_numbers(tmp_path: Path) -> None:
    file = written(tmp_path, "t,from,to,range\n1,2,03,4\n")
    (m,) = read(f"{file},robots=by number", ["turtle02", "turtle03"]).log.measurements
    assert (m.receiver, m.transmitter) == ("turtle02", "turtle03")
    with pytest.raises(InputError, match="numbers of their own"):
        read(f"{file},robots=by number", ["a1", "b1"])


@given(
    st.lists(
        st.tuples(st.integers(0, 2**60), st.integers(1, 900_000), st.sampled_from(["7", "12"])),
        max_size=20,
        unique=True,
    )
)
def test_units_and_ids_go_round(rows: list[tuple[int, int, str]]) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        text = "ns,from,to,mm\n" + "".join(f"{ns},{tag},{'7' if tag == '12' else '12'},{mm}\n" for ns, mm, tag in rows)
        file = written(Path(folder), text + "5,7,12,5\n")
        word = f"{file},stamp=ns,stamp_unit=ns,range=mm,unit=mm,robots.7=a,robots.12=b,max_range=1000"
        log = read(word, ["a", "b"]).log
        write_wireless_log(Path(folder) / "w.jsonl", log)
        assert read_wireless_log(Path(folder) / "w.jsonl") == log
    expected = {(ns, mm / 1000, {"7": "a", "12": "b"}[tag]) for ns, mm, tag in [*rows, (5, 5, "7")]}
    assert {(m.stamp_ns, m.range_m, m.receiver) for m in log.measurements} == expected


def test_mutated_tables_give_one_line_or_measurements(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = b"".join(b"%d.5,7,12,%d.25\n" % (i, i % 9 + 1) for i in range(60))
    whole = bytearray(b"time,tag,anchor,range\n" + rows)
    for _ in range(200):
        content = bytearray(whole)
        for _ in range(rng.integers(1, 8)):
            content[rng.integers(len(content))] = rng.integers(256)
        (tmp_path / "m.csv").write_bytes(content)
        try:
            reading = read(str(tmp_path / "m.csv"))
        except InputError as error:
            assert str(tmp_path) in str(error)  # noqa: PT017
        else:
            assert reading.account is not None
            left = sum(reading.account.left_out.values())
            assert reading.account.used + left == reading.account.rows


# ---------------------------------------------------------------------------------------------------------------- lines
@pytest.mark.parametrize(
    ("preset", "text"),
    [
        ("dwm1001-lec", "1700000000.5,DIST,2,AN0,022E,7.94,8.03,0.00,3.44,AN1,9280,7.95,0.00,0.00,5.68,POS,1,2,3,52\n"),
        ("dwm1001-les", "1700000000.5 022E[7.94,8.03,0.00]=3.44 9280[7.95,0.00,0.00]=5.68 le_us=3082 est[6,5,-1,53]\n"),
    ],
)
def test_lines_of_a_dwm1001(tmp_path: Path, preset: str, text: str) -> None:
    file = written(tmp_path, text, "uart.log")
    reading = read(f"{file},preset={preset},receiver=alpha,robots.022e=beta,robots.9280=gamma")
    assert [(m.stamp_ns, m.transmitter, m.range_m) for m in reading.log.measurements] == [
        (1_700_000_000_500_000_000, "beta", 3.44),
        (1_700_000_000_500_000_000, "gamma", 5.68),
    ]


def test_a_pattern_with_the_names_of_fields(tmp_path: Path) -> None:
    file = written(tmp_path, "at 12.5 tag 7 heard 12: 3000 mm\nnoise\n", "a.log")
    config = written(
        tmp_path,
        "path: a.log\npattern: 'at (?P<stamp>\\S+) tag (?P<from>\\d+) heard (?P<to>\\d+): (?P<range>\\d+)'\n"
        "unit: mm\nmax_range: 50\nrobots: {7: alpha, 12: beta}\n",
        "radio.yaml",
    )
    (source,) = sources_of_words([str(config)])
    assert source.path == file
    with pytest.raises(InputError, match="1 of 2 rows cannot be read"):
        read_radio(source)
    file.write_text(file.read_text() + "at 13 tag 12 heard 7: 3100 mm\n")
    assert [m.range_m for m in read_radio(source).log.measurements] == [3.0, 3.1]


# ------------------------------------------------------------------------------------------ graphs, WSR, our own
def test_factor_graphs(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        "VERTEX_SE2 0.1 A0 0 0 0\nVERTEX_XY L0 1 1\nEDGE_RANGE 2.123456789 A2 B5 0.853187 0.04\n"
        "EDGE_RANGE 3 A2 L0 1 0.04\n",
        "graph.pyfg",
    )
    reading = read(f"{file},robots.A=alpha,robots.B=beta,anchors=L0", ["alpha", "beta"])
    (m,) = reading.log.measurements
    assert reading.kind == "pyfg"
    assert (m.stamp_ns, m.receiver, m.transmitter, m.range_m) == (2_123_456_789, "alpha", "beta", 0.853187)
    assert m.range_sigma_m == pytest.approx(0.2)


def test_wsr_output_needs_its_times(data_dir: Path) -> None:
    file = data_dir / "wifi_aoa" / "LOS_Set_A_using_t265_displacement.json"
    with pytest.raises(InputError, match=r"holds no times.*add stamps: \{1: SECONDS"):
        read(str(file))
    (source,) = sources_of_words([f"{file},robots.5=alpha,robots.tx3=beta"])
    trials = json.loads(file.read_text())
    source = source.model_copy(update={"stamps": {trial: 10.0 * float(trial) for trial in trials}})
    log = read_radio(source).log
    assert {"alpha", "beta"} <= log.robots()
    assert log.measurements[0].stamp_ns == 10 * 10**9
    assert log.measurements[0].aoa_frame == "odometry"


def test_json_lines_with_corrections(tmp_path: Path) -> None:
    log = WirelessLog((WirelessMeasurement(10**9, "7", "12", 20534.0, 0.3, (AoaPath(0.5, 0.1),)),))
    write_wireless_log(tmp_path / "w.jsonl", log)
    assert read(str(tmp_path / "w.jsonl")).log == log
    word = f"{tmp_path}/w.jsonl,unit=mm,clockwise=true,time_offset=-0.5,robots.7=a,robots.12=b"
    (m,) = read(word).log.measurements
    assert (m.stamp_ns, m.receiver, m.transmitter, m.range_m) == (500_000_000, "a", "b", 20.534)
    assert (m.range_sigma_m, m.paths[0].azimuth) == (0.3, -0.5)


def test_whole_seconds_that_end_in_zeros_are_times(tmp_path: Path) -> None:
    file = written(tmp_path, "t,from,to,range\n" + "".join(f"{1_700_000_000 + 1000 * k},a,b,3\n" for k in range(5)))
    assert len(read(str(file)).log.measurements) == 5


@pytest.mark.parametrize(
    ("range_name", "sigma_name"), [("range_mm", "sigma_m"), ("range_m", "std_mm"), ("range", "std [cm]")]
)
def test_a_sigma_in_another_unit_is_not_read_in_that_of_the_ranges(
    tmp_path: Path, range_name: str, sigma_name: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = written(tmp_path, f"t,from,to,{range_name},{sigma_name}\n1.5,a,b,9,5\n")
    assert read(str(file)).log.measurements[0].range_sigma_m == 0.5
    assert f"column {sigma_name} is not in the unit of the ranges" in caplog.text


def test_a_sigma_in_the_unit_of_the_ranges(tmp_path: Path) -> None:
    file = written(tmp_path, "t,from,to,range_mm,sigma_mm\n1.5,a,b,9000,50\n")
    assert read(str(file)).log.measurements[0].range_sigma_m == 0.05


def test_an_acceleration_is_no_azimuth(tmp_path: Path) -> None:
    file = written(tmp_path, "t,from,to,ax,ay,az\n1.5,a,b,1,2,3\n")
    with pytest.raises(InputError, match="no column of ranges is known"):
        read(str(file))


@pytest.mark.parametrize("tag", ["0010", "0x0A1B", "1_1", "DE:CA:00:07", "12:30", "2587"])
@pytest.mark.parametrize("key", ["0010", "0x0a1b", "1_1", "de:ca:00:07", "12:30", "0xA1B"])
def test_ids_in_yaml_are_what_is_written(tmp_path: Path, tag: str, key: str) -> None:
    written(tmp_path, f"t,from,to,range\n1.5,{tag},b,9\n")
    source = written(tmp_path, f"{{path: uwb.csv, robots: {{{key}: alpha, b: beta}}}}\n", "radio.yaml")
    found = [m.receiver for m in read(str(source)).log.measurements]
    numbers = {"0x0A1B": "2587", "0x0a1b": "2587", "0xA1B": "2587"}
    same = numbers.get(tag, tag).casefold() == numbers.get(key, key).casefold()
    assert found == (["alpha"] if same else [])


def degrees_log(folder: Path) -> Path:
    records = [
        {"type": "wireless", "stamp": 1.5, "receiver": "a", "transmitter": "b", "range": 3.0,
         "paths": [{"azimuth": 190.0, "elevation": 30.0, "sigma": 10.0}]},
        {"type": "heading", "stamp": 1.5, "robot": "a", "heading": 90.0, "sigma": 5.0},
    ]  # fmt: skip
    return written(folder, "".join(f"{json.dumps(record)}\n" for record in records), "w.jsonl")


def test_json_lines_in_degrees(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    log = read(f"{degrees_log(tmp_path)},angle_unit=deg,clockwise=true").log
    (path,) = log.measurements[0].paths
    np.testing.assert_allclose([path.azimuth, path.elevation, path.sigma], np.radians([170, 30, 10]))
    np.testing.assert_allclose([log.headings[0].heading, log.headings[0].sigma], np.radians([90, 5]))
    assert "degrees" not in caplog.text


def test_json_lines_in_degrees_without_saying_so_are_refused_with_the_key(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'line 1: "elevation" is 30.0.*add angle_unit: deg'):
        read(str(degrees_log(tmp_path)))


@pytest.mark.parametrize("setting", ["stamp_unit=ms", "receiver=a", "range=d", "take=range"])
def test_settings_that_json_lines_cannot_use_are_refused(tmp_path: Path, setting: str) -> None:
    with pytest.raises(ConfigError, match=f"JSON Lines cannot use {setting.partition('=')[0].partition('.')[0]}"):
        read(f"{degrees_log(tmp_path)},angle_unit=deg,{setting}")
