"""Adapter: our own identification with the order given, and as the command line does it, which chooses the order."""

from protocol import Case, Model, main

from archerfish.identification.axis.gimbal import AxisIdentification, identify_axis
from archerfish.identification.axis.order_choice import USUAL_ORDERS, choose_order
from archerfish.records.recording import Recording, make_recording


def identify(case: Case) -> Model:
    """Identify one axis of the given order."""
    return _model(identify_axis([_recording(case)], case.order))


def choose(case: Case) -> Model:
    """Identify one axis of the order that suits the recording."""
    return _model(choose_order([_recording(case)], orders=USUAL_ORDERS).result)


def _recording(case: Case) -> Recording:
    names = [f"u{index}" for index in range(case.inputs.shape[1])]
    return make_recording(case.inputs, case.output, case.sample_period_s, input_names=names)


def _model(result: AxisIdentification) -> Model:
    plant = result.plant
    matrices = {"A": plant.A, "B": plant.B, "C": plant.C, "D": plant.D}
    return {**matrices, "delay_samples": plant.delay_samples, "offset": result.offset.item()}


if __name__ == "__main__":
    main({"identify_axis": identify, "choose_order": choose})
