"""Adapter: our own identification, with no option but the order."""

from protocol import Case, Model, main

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.records.recording import make_recording


def identify(case: Case) -> Model:
    """Identify one axis."""
    names = [f"u{index}" for index in range(case.inputs.shape[1])]
    recording = make_recording(case.inputs, case.output, case.sample_period_s, input_names=names)
    result = identify_axis([recording], case.order)
    plant = result.plant
    matrices = {"A": plant.A, "B": plant.B, "C": plant.C, "D": plant.D}
    return {**matrices, "delay_samples": plant.delay_samples, "offset": result.offset.item()}


if __name__ == "__main__":
    main({"identify_axis": identify})
