"""Write tests2/infantry: the robot that the first edition identified in its laboratory, as the second edition keeps it.

python tests2/against_first/write_infantry.py
"""

from dataclasses import asdict
from pathlib import Path

from archerfish.records.limits import read_limits
from archerfish.records.muzzle import read_muzzle
from archerfish.records.plant import read_plant
from archerfish.records.sensing import read_sensing
from archerfish2.records.limits import LimitsRecord
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.records.plant import PlantRecord
from archerfish2.records.sensing import SensingRecord
from archerfish2.robot import Robot

ROOT = Path(__file__).parents[2]
RECORDS = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"
FOLDER = ROOT / "tests2" / "infantry"


def infantry() -> Robot:
    """Return the robot; the verdicts on its plants stay behind."""
    axes = {axis: vars(read_plant(RECORDS / f"{axis}.json")) for axis in ("pitch", "yaw")}
    for fields in axes.values():
        del fields["quality"]
    return Robot(
        name="infantry",
        pitch=PlantRecord(**axes["pitch"]),
        yaw=PlantRecord(**axes["yaw"]),
        muzzle=MuzzleRecord(**asdict(read_muzzle(RECORDS / "muzzle.json"))),
        sensing=SensingRecord(**asdict(read_sensing(RECORDS / "sensing.json"))),
        limits=LimitsRecord(**asdict(read_limits(RECORDS / "limits.json"))),
    )


if __name__ == "__main__":
    infantry().save(FOLDER)
    print(f"{FOLDER}: {infantry().digest()}")  # noqa: T201
