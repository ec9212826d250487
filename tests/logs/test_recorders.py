"""What people really record: logs as other tools spell them, against the plants that made them and their twins."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat

from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.robot_files import read_axis, read_folder
from archerfish.logs.log import read_log
from archerfish.logs.timing import read_detections

CASES = "data/cases_2"
RNG = np.random.default_rng(5)
TIME = np.arange(400) / 100
U = np.repeat(RNG.uniform(-9, 9, 20), 20)
Y = np.convolve(U, np.exp(-np.arange(60) / 6) / 6)[:400]


def table(time=TIME, names="time_s,u,y", lines=()):
    rows = [f"{t},{u:.6f},{y:.6f}" for t, u, y in zip(time, U, Y, strict=False)]
    for number, line in lines:
        rows.insert(number, line)
    return "\n".join([names, *rows, ""])


def read(folder, content, name="log.csv", **signals):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_log(folder / name, **signals)


def codes(log):
    return {each.code for each in log.findings} - {"saturation"}


def same(log, *lengths):
    """Check that the recordings of a log have the samples of the table, in parts of such lengths."""
    assert [len(each) for each in log.recordings] == list(lengths or [400])
    outputs = np.concatenate([each.outputs[:, 0] for each in log.recordings])
    assert_allclose(outputs, Y[: sum(lengths) or 400], atol=2e-6)
    assert log.recordings[0].period_s == pytest.approx(0.01)


CASE = [
    ("names_again.csv", "time_s", "u y", 5, {"names-again", "new-recording"}),
    ("time_of_day.csv", "time", "u y", 5, {"clock-wrap"}),
    ("lines.jsonl", "time_s", "u y", 5, set()),
    ("struct.mat", "data.time", "data.u data.y", 5, set()),
    ("boot_and_wall_clock", "time_s", "/gimbal_command/yaw/position /joint_states/yaw/position", 4, {"clocks"}),
    ("imu_orientation", "time_s", "/gimbal/yaw_command/point/x /gimbal/imu/orientation/yaw", 4, set()),
]


@pytest.mark.parametrize(("name", "time", "signals", "natural_hz", "expected"), CASE, ids=[each[0] for each in CASE])
def test_the_cases_give_the_plant_that_made_them(name, time, signals, natural_hz, expected, shared):
    """All have a steady gain of 1 and a delay of at most 10 ms."""
    pytest.importorskip("rosbags" if signals[0] == "/" else "numpy")
    inputs, outputs = signals.split()
    log = read_log(shared(f"{CASES}/{name}"), inputs=inputs, outputs=outputs, time=time)
    assert codes(log) == expected
    fit, period = fit_axis(log.recordings, 2), log.recordings[0].period_s
    pole = np.log(fit.poles[0].astype(complex)) / period
    assert_allclose((abs(pole) / 2 / np.pi, fit.plant.dc_gain.item()), (natural_hz, 1), rtol=5e-3)
    assert 0 <= fit.structure.delay * period <= 0.0101


AGAIN, LATER, BOTH = (200, "time_s,u,y"), TIME[:200], {"names-again", "new-recording"}
RUNS = {  # stamps, further lines; findings
    "names after a page": (TIME, [(200, '"Time_s", u , y')], [400], {"names-again"}),
    "a later start": (np.append(7 + LATER, 3 + LATER), [AGAIN], [200, 200], BOTH),
    "behind a torn line": (np.append(LATER, LATER), [(200, "1.9,0.time_s,u,y")], [200, 200], BOTH),
    "without names": (np.append(LATER, LATER), [], [200, 200], {"new-recording"}),
    "three of them": (np.tile(TIME[:100], 3), [], [100] * 3, {"new-recording"}),
}


@pytest.mark.parametrize(("time", "lines", "lengths", "expected"), RUNS.values(), ids=RUNS)
def test_recordings_that_were_appended_to_one_file_are_separated(tmp_path, time, lines, lengths, expected):
    log = read(tmp_path, table(time, lines=lines))
    same(log, *lengths)
    assert codes(log) == expected
    assert log.samples == sum(lengths) + sum(each.samples for each in log.findings)


def test_names_in_another_order_are_refused(tmp_path, refused):
    refused('line 202: has "time_s,y,u".*; cut the log there', read, tmp_path, table(lines=[(200, "time_s,y,u")]))


CLOCKS = {
    "time of day": lambda _, hours: hours,
    "ISO 8601": lambda day, hours: f"{day}T{hours}Z",
    "a date and microseconds": lambda day, hours: f"{day} {hours}000",
    "slashes and a zone": lambda day, hours: f"{day.replace('-', '/')} {hours}+08:00",
    "an American date": lambda day, hours: f"{day[5:].replace('-', '/')}/2026 {hours}",
    "minutes of a spreadsheet": lambda _, hours: hours[3:],
    "halves of a day": lambda _, hours: f"{int(hours[:2]) % 12 or 12}{hours[2:]} {'PM' if hours > '12' else 'AM'}",
    "colons": lambda _, hours: hours.replace(".", ":"),
    "the name of a zone": lambda day, hours: f"{day} {hours} UTC",
    "hours of a zone": lambda day, hours: f"{day}T{hours}+08",
    "without marks": lambda day, hours: f"{day}T{hours}Z".replace("-", "").replace(":", ""),
}
COUNTERS = {"16 bits [ms]": ("time_ms", 2**16, 1e3), "32 bits [us]": ("time_us", 2**32, 1e6), "a day": ("t", 86_400, 1)}


@pytest.mark.parametrize("form", CLOCKS.values(), ids=CLOCKS)
def test_times_of_day_are_read_through_midnight(tmp_path, form):
    instants = np.datetime64("2026-11-28T23:59:58") + (1000 * TIME).round().astype("timedelta64[ms]")
    texts = [form(*text.split("T")) for text in np.datetime_as_string(instants, unit="ms").tolist()]
    log = read(tmp_path, table(texts, "time,u,y"), time="time")
    same(log)
    assert codes(log) <= {"clock-wrap"}


def test_the_hour_that_summer_time_ends_with_goes_on(tmp_path):
    texts = [f"2026-10-25 02:{59 * (k < 100):02}:{(5900 + k) / 100 % 60:06.3f}" for k in range(400)]
    log = read(tmp_path, table(texts, "time,u,y"), time="time")
    same(log)
    assert codes(log) == {"clock-wrap"}


@pytest.mark.parametrize(("name", "range_", "per_second"), COUNTERS.values(), ids=COUNTERS)
def test_a_counter_that_rolls_over_goes_on(tmp_path, name, range_, per_second):
    stamps = np.round((TIME - 1.5) * per_second, 3) % range_
    log = read(tmp_path, table(stamps, f"{name},u,y"), time=name)
    same(log)
    assert "clock-wrap" in codes(log)


def test_runs_that_are_nearly_as_long_as_a_counters_range_are_recordings():
    time = np.tile(0.01 * np.arange(427), 2)  # 32 bits of nanoseconds are 4.295 s
    log = read_log({"time_s": time, "u": np.sign(np.sin(9 * time)), "y": np.sin(9 * time)})
    assert [len(each) for each in log.recordings] == [427, 427]
    assert codes(log) == {"new-recording"}


def test_units_are_of_the_file_that_logs_toml_names(tmp_path):
    (tmp_path / "logs.toml").write_text(
        '[yaw]\nfit = ["a.csv", "b.csv"]\ninput_unit = "deg"\n[yaw.files."b.csv"]\nunit = "rad"\n'
    )
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(table())
    files = read_folder(tmp_path).axis("yaw")
    first, other = (read_axis(tmp_path / name, files).recordings[0] for name in files.fit)
    assert_allclose(first.inputs, np.radians(other.inputs))
    assert_allclose(first.outputs, other.outputs)


def test_samples_out_of_order_are_no_counter(tmp_path, refused):
    late = np.where(np.arange(400) == 200, TIME - 0.06, TIME)  # 2**16 µs are 0.0655 s
    refused("line 202: time 1.94 s does not come after 1.99 s", read, tmp_path, table(late))


ROWS = [{"time_s": float(t), "u": float(u), "y": float(y)} for t, u, y in zip(TIME, U, Y, strict=True)]
ARRAYS = {name: [row[name] for row in ROWS] for name in ROWS[0]}
INNER = [{"t": row["time_s"], "axis": {"u": row["u"], "y": [0, row["y"]]}} for row in ROWS]
NESTED = {"time": "t", "inputs": "axis.u", "outputs": "axis.y[1]"}
LISTS = {"time": "[0]", "inputs": "[1]", "outputs": "[2]"}
INSIDE = {"time": "log.time_s", "inputs": "log.u", "outputs": "log.y"}
LINES = "\n".join(map(json.dumps, ROWS))
JSON = {
    "objects": (json.dumps(ROWS, indent=1), {}, set()),
    "lines": (LINES, {}, set()),
    "half a line": (LINES + '\n{"time_s": 4.0, "u"', {}, {"truncated"}),
    "UTF-16": (LINES.encode("utf-16"), {}, set()),
    "arrays": (json.dumps(ARRAYS), {}, set()),
    "a frame of pandas": (json.dumps({k: {str(i): x for i, x in enumerate(v)} for k, v in ARRAYS.items()}), {}, set()),
    "objects inside": (json.dumps({"robot": "red", "log": ROWS}), INSIDE, set()),
    "nested": (json.dumps(INNER), NESTED, set()),
    "lists": (json.dumps([[*row.values()] for row in ROWS]), LISTS, set()),
    "a list a line": ("\n".join(json.dumps([*row.values()]) for row in ROWS), LISTS, set()),
    "no JSON": (table(names="[0],[1],[2]"), LISTS, set()),
}


@pytest.mark.parametrize(("content", "signals", "expected"), JSON.values(), ids=JSON)
def test_json_is_read_whatever_its_layout(tmp_path, content, signals, expected):
    log = read(tmp_path, content, **signals)
    same(log)
    assert codes(log) == expected


def test_what_is_wrong_in_json_is_named(tmp_path, refused):
    refused('has no array "v"; the arrays are "time_s", "u", "y"; name', read, tmp_path, LINES, inputs="v")
    refused(r"log\.csv: line 3: is JSON that is damaged", read, tmp_path, LINES.replace(": 0.02,", " 0.02,"))
    refused('row 3: column "u" is "on"', read, tmp_path, json.dumps([*ROWS[:2], ROWS[2] | {"u": "on"}]))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_editors_of_windows_may_have_saved_logs_toml(tmp_path, encoding, shared):
    text = shared(f"{CASES}/toml_with_mark/logs.toml").read_text("utf-8-sig")
    (tmp_path / "logs.toml").write_bytes(text.encode(encoding))
    assert read_folder(tmp_path).pitch.unit == "deg"


STRUCT = {"time": TIME[:, None], "u": U[:, None], "signals": {"values": np.column_stack([0 * Y, Y]), "label": "yaw"}}
EACH = np.rec.fromarrays([TIME, U, Y], names="t,u,y")
ARRAYS_OF = {  # what writes a file; its signals
    "a struct of Simulink": (lambda path: savemat(path, {"out": STRUCT}), "out.time out.u out.signals.values[1]"),
    "a struct for each row": (lambda path: savemat(path, {"s": EACH}), "s.t s.u s.y"),
    "a structured array": (lambda path: np.savez(path, log=EACH, other=np.ones(3)), "log.t log.u log.y"),
    "a single structured array": (lambda path: np.save(path, EACH), "t u y"),
}


@pytest.mark.parametrize(("write", "names"), ARRAYS_OF.values(), ids=ARRAYS_OF)
def test_signals_in_structs_are_read_and_listed(tmp_path, write, names, refused):
    with (tmp_path / "log").open("wb") as file:
        write(file)
    time, inputs, outputs = names.split()
    same(read_log(tmp_path / "log", time=time, inputs=inputs, outputs=outputs))
    refused(f'the arrays are .*"{outputs.partition("[")[0]}"', read_log, tmp_path / "log", time="data")


def test_a_structured_array_in_memory_and_stamps_of_a_frame_are_read():
    same(read_log(EACH, time="t"))
    stamps = np.datetime64("2026-11-28T23:59:58") + (1e6 * TIME).round().astype("timedelta64[us]")
    same(read_log({"time": stamps, "u": U.tolist(), "y": list(map(str, Y))}, time="time"))


def test_signs_and_units_are_given_beside_the_names(tmp_path):
    (plain,), (given,) = (
        read(tmp_path, table(), **more).recordings
        for more in ({}, {"inputs": "-u", "outputs": ["-y", "u"], "output_unit": "deg"})
    )
    assert_allclose(given.inputs, -plain.inputs, rtol=1e-12)
    assert_allclose(given.outputs, np.radians(np.hstack([-plain.outputs, plain.inputs])), rtol=1e-12)


def test_a_command_is_unwrapped_where_its_angle_does_not_jump(tmp_path):
    """Its steps are as large as half a turn, so that by itself it shows no wrap."""
    u = np.cumsum(RNG.uniform(-120, 120, 20)).repeat(20)
    y = np.convolve(u, np.exp(-np.arange(200) / 9) * (1 - np.exp(-1 / 9)))[:400]
    signals = {"time_s": TIME, "u": (u + 180) % 360 - 180, "y": (y + 180) % 360 - 180}
    (recording,) = read_log(signals).recordings
    assert_allclose(np.diff(recording.inputs[:, 0]), np.diff(u), atol=1e-9)
    assert_allclose(np.diff(recording.outputs[:, 0]), np.diff(y), atol=1e-9)


@pytest.mark.parametrize("word", ["NaN", "#N/A", "null", "-", "", "-nan(ind)", "NA"])
def test_missing_values_are_those_of_any_tool(tmp_path, word):
    rows = table().split("\n")
    rows[6] = f"0.05,{word},{Y[5]:.6f}"
    log = read(tmp_path, "\n".join(rows))
    same(log)
    assert codes(log) == {"held-input"}


def test_detections_that_are_written_again_are_left_out(tmp_path):
    rows = [f"{k // 3 / 60},3,{k // 3 / 99},0,{k / 180 + 0.01}" for k in range(300)]
    (tmp_path / "plate.csv").write_text("\n".join(["time_s,x,y,z,receive_s", *rows, ""]))
    detections = read_detections(tmp_path / "plate.csv", findings=(findings := []))
    assert (len(detections.time), [each[:2] + each[-1:] for each in findings]) == (
        100,
        [("time-duplicate", "repaired", 200)],
    )
    assert_allclose(detections.receive, np.arange(100) / 60 + 0.01)


def test_stamps_of_detections_may_fall_where_their_receipts_go_on(tmp_path, refused):
    rows = [f"{k / 60 - 0.04 * (k > 50)},3,{k / 99},0,{k / 60}" for k in range(100)]
    (tmp_path / "plate.csv").write_text("\n".join(["time_s,x,y,z,receive_s", *rows, ""]))
    assert np.diff(read_detections(tmp_path / "plate.csv").time).min() < 0
    (tmp_path / "plate.csv").write_text("\n".join(["time_s,x,y,z,other", *rows, ""]))
    refused("line 53: stamps do not increase; cut the log", read_detections, tmp_path / "plate.csv")
