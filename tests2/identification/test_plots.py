"""Plots of an axis: what they show, of one input and of two, and that nothing is written."""

import numpy as np

from archerfish2.identification.axis.plots import bode_plot, correlation_plot, run_plot, step_plot
from archerfish2.identification.frequency import measured_response
from archerfish2.identification.residuals import parameter_errors, residual_tests
from archerfish2.identification.simulation import simulate
from archerfish2.identification.validation import free_run
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.style import svg_text


def test_plots_show_plant_band_and_measurement():
    rng, one = np.random.default_rng(0), PlantRecord.second_order(10, 0.4, 0.02)
    two = one.replace(B=np.hstack([one.B, 2 * one.B]), D=np.zeros((1, 2)), input_names=("u", "v"))
    two = two.replace(
        draws={n: np.stack([getattr(two, n)] * 20) * rng.normal(1, 0.1, (20, 1, 1)) ** (n == "B") for n in "ABCD"}
    )
    for plant, inputs in ((one, 1), (two, 2)):
        u = rng.normal(size=(3000, inputs))
        y = simulate(plant, u) + 0.01 * rng.normal(size=(3000, 1))
        log = Recording.from_arrays(u, y, 1e-3, input_names=plant.input_names)
        y[2900] += 9
        run, errors = free_run(plant, u, log.outputs), parameter_errors(plant, u)
        figures = [
            run_plot(log, run, errors, title="run"),
            bode_plot(plant, measured_response([log]), (1, 50), title="bode"),
            step_plot(plant, title="step"),
            correlation_plot(residual_tests((log.outputs - run.outputs)[:, 0], u), title="correlation"),
        ]
        assert [len(each.axes) for each in figures] == [2, 2 * inputs, inputs, inputs]
        assert all("<svg" in svg_text(each) for each in figures)
        assert ["95 % band" in [text.get_text() for text in each.legends[0].texts] for each in figures[:3]] == [
            inputs == 2
        ] * 3
        phase, step = figures[1].axes[inputs].lines, figures[2].axes[0].lines
        assert phase[0].get_ydata()[-1] < -3600  # 20 ms up to 500 Hz are ten turns
        assert np.abs(phase[1].get_ydata() - np.interp(phase[1].get_xdata(), *phase[0].get_data())).max() < 30
        assert np.ptp([step[0].get_ydata()[-1], step[1].get_ydata()[0], 1]) < 0.01
        shown = figures[0].axes[0].lines[0].get_data()
        assert len(shown[0]) == 2000
