"""Recorded logs through `archerfish identify gimbal`, with no option beyond the columns; and a minute of a 1 kHz bag.

Run: python benchmarks/logs.py; it needs ../shared/data beside the repository and writes results/logs.json.
"""

import contextlib
import io
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.signal import lfilter

from archerfish.cli.main import main
from archerfish.records.log_files import read_log
from archerfish.records.storage import write_json

ROOT = Path(__file__).parents[1]
DATA = ROOT / ".." / "shared" / "data" / "identification"
RESULTS = ROOT / "benchmarks" / "results" / "logs.json"

DRONE = ["--time", "tempo_ms", "--output", "angulo_deg", "--input"]
LOOP = ["--time", "Tempo_s", "--output", "Saida_y", "--input"]
HOOP = ["--time", "time", "--input", "u", "--output", "y"]


def _columns(inputs: str, output: str, period_s: float) -> list[str]:
    return ["--input", *inputs.split(), "--output", output, "--sample-period-s", str(period_s)]


CASES = [
    ("slicot_sysid/robot_arm_dat.mat", _columns("robot_arm_dat[0]", "robot_arm_dat[1]", 0.01)),
    (
        "slicot_sysid/CD_player_arm_dat.mat",
        _columns("CD_player_arm_dat[0] CD_player_arm_dat[1]", "CD_player_arm_dat[3]", 1 / 2048),
    ),
    (
        "slicot_sysid/flexible_structure_dat.mat",
        _columns("flexible_structure_dat[0] flexible_structure_dat[1]", "flexible_structure_dat[2]", 0.01),
    ),
    ("rgp/ballbeam.dat", _columns("1", "2", 0.1)),
    ("rgp/dryer.dat", _columns("1", "2", 0.08)),
    ("rgp/flutter.dat", _columns("1", "2", 0.01)),
    ("drgp_vss/actuator.mat", _columns("X[0]", "y", 0.05)),
    *(("drgp_vss/drive.mat", _columns(f"u{run}", f"z{run}", 0.02)) for run in (1, 2, 3)),
    ("drgp_vss/cascaded.mat", _columns("X", "y", 4.0)),
    ("drgp_vss/damper.mat", _columns("X", "y", 0.005)),
    *(
        (f"quarter_drone/{name}", [*DRONE, command])
        for name in ("dados_14_drone.csv", "14_drone_seq_20260529_195254.csv")
        for command in ("referencia", "u_pct")
    ),
    *(
        (f"quarter_drone/{name}_malha_fechada.csv", [*LOOP, command])
        for name in ("sinal1_semi_estatica", "sinal2_degraus", "sinal3_swept_sine", "sinal4_multiseno")
        for command in ("Referencia", "Controle_u")
    ),
    *((f"ball_and_hoop/{name}.mat", HOOP) for name in ("closedLoop", "fixedStepSequence", "randomStepSequence")),
    ("silverbox/SNLS80mV.csv", _columns("V1", "V2", 1 / 610.35)),
]


def identify(words: list[str]) -> dict[str, object]:
    """Run the command; return its exit status, time and what it found or why it refused."""
    with tempfile.TemporaryDirectory() as folder:
        summary, said = Path(folder) / "summary.json", io.StringIO()
        start, status = time.perf_counter(), 0
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                main(["identify", "gimbal", *words, "--out", folder, "--json", str(summary)])
        except SystemExit as ended:
            status = int(ended.code or 0)
        facts = {"status": status, "seconds": round(time.perf_counter() - start, 2)}
        if status:
            return facts | {"reason": said.getvalue().strip()}
        found = json.loads(summary.read_text())
        return facts | {
            "headline": found["headline"],
            "fit_percent": [round(row["fit_percent"], 1) for row in found["training"]],
            "codes": sorted({row["code"] for row in found["findings"]}),
        }


def write_minute(path: Path) -> None:
    """Write 60 s of two joints at 1 kHz as a ROS 2 bag: steps of yaw's command in `effort`, its angle in `position`."""
    types, kind = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/JointState"
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(-0.2, 0.2, 300), 200)
    angle = lfilter([0, 0, 6e-4], [1, -1.95, 0.9506], command) + 1e-4 * rng.standard_normal(command.size)
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=9) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=types)
        for index, (u, y) in enumerate(zip(command, angle, strict=True)):
            time_ns = index * 10**6
            top = header(stamp(time_ns // 10**9, time_ns % 10**9), "base")
            values = [np.array([0.0, each]) for each in (y, 0.0, u)]
            message = types.types[kind](top, ["pitch", "yaw"], *values)
            writer.write(connection, time_ns, types.serialize_cdr(message, kind))


def minute_of_a_bag() -> dict[str, object]:
    """Return how long a minute at 1 kHz takes to read (best of three), and what the command says of it."""
    inputs, output = "/joint_states/yaw/effort", "/joint_states/yaw/position"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        write_minute(path)
        times = []
        for _ in range(3):
            start = time.perf_counter()
            read_log(path, [inputs], [output], time=None)
            times.append(time.perf_counter() - start)
        return {"read_s": round(min(times), 3)} | identify([str(path), "--input", inputs, "--output", output])


if __name__ == "__main__":
    results: dict[str, object] = {"minute_of_a_bag": minute_of_a_bag()}
    print("60 s of a 1 kHz bag:", results["minute_of_a_bag"])
    for name, words in CASES:
        found = identify([str(DATA / name), *words])
        results[f"{name} {' '.join(words)}"] = found
        print(f"{name}: {found}")
    write_json(RESULTS, results)
