import numpy as np
import pytest

from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.muzzle.landing import landing_distance
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import make_recording
from archerfish.records.shots import Shots

MUZZLE = {
    "speed": 18.0,
    "speed_sd": 0.4,
    "pitch_offset": 0.007,
    "pitch_sd": 0.006,
    "yaw_offset": -0.004,
    "yaw_sd": 0.005,
    "drag": 0.019,
    "height": 0.4,
}
"""Truth of the simulated shots."""


def make_resonant_plant(delay=0, feedthrough=0.0, inputs=1):
    """Order 4, stable, with poles at 0.9 ± 0.2i, 0.7 and 0.3; a second input enters elsewhere."""
    A = np.array([[0.9, 0.2, 0.1, 0.0], [-0.2, 0.9, 0.0, 0.1], [0.0, 0.0, 0.7, 0.2], [0.0, 0.0, 0.0, 0.3]])
    B = np.array([[0.1, -0.2], [0.2, 0.3], [-0.1, 0.5], [0.4, 0.1]])[:, :inputs]
    C = np.array([[1.0, 0.5, -0.3, 0.2]])
    names = tuple(f"u{index}" for index in range(inputs))
    return PlantRecord(A, B, C, np.full((1, inputs), feedthrough), delay, 0.01, input_names=names)


def make_second_order(frequency_hz, damping, delay, sample_period_s=1e-3):
    """Order 2 of steady gain 1, from its natural frequency."""
    pole = np.exp(2 * np.pi * frequency_hz * sample_period_s * (-damping + 1j * np.sqrt(1 - damping**2)))
    first, second = -2 * pole.real, abs(pole) ** 2
    half = (1 + first + second) / 2
    A = np.array([[-first, 1.0], [-second, 0.0]])
    return PlantRecord(A, np.full((2, 1), half), np.array([[1.0, 0.0]]), np.zeros((1, 1)), delay, sample_period_s)


def simulated_recording(plant, inputs, *, noise=0.0, offset=0.0, initial_state=None, seed=0):
    """Simulate a recording with white measurement noise, given as a share of the clean output's deviation."""
    inputs = inputs.reshape(len(inputs), -1)
    clean = simulate(plant, inputs, initial_state)
    measured = clean + offset + noise * clean.std() * np.random.default_rng(seed).standard_normal(clean.shape)
    return make_recording(
        inputs, measured, plant.sample_period_s, input_names=plant.input_names, source=f"simulated {seed}"
    )


@pytest.fixture
def white():
    """White input of 600 samples and two channels."""
    return np.random.default_rng(7).standard_normal((600, 2))


@pytest.fixture
def resonant_plant():
    return make_resonant_plant


@pytest.fixture
def second_order():
    return make_second_order


@pytest.fixture
def record():
    return simulated_recording


def fire_shots(pitch_deg, each, *, planes=(), speeds=True, lateral=False, seed=0):
    """Fire at each pitch, and at each plane if there are any, by the flight of the simulator."""
    rng = np.random.default_rng(seed)
    pitch = np.radians(np.repeat(np.asarray(pitch_deg, float), each * max(len(planes), 1)))
    speed = MUZZLE["speed"] + MUZZLE["speed_sd"] * rng.standard_normal(pitch.size)
    departure = pitch + MUZZLE["pitch_offset"] + MUZZLE["pitch_sd"] * rng.standard_normal(pitch.size)
    azimuth = MUZZLE["yaw_offset"] + MUZZLE["yaw_sd"] * rng.standard_normal(pitch.size)
    measured = speed if speeds else None
    if planes:
        plane = np.tile(np.repeat(np.asarray(planes, float), each), len(pitch_deg))
        level = np.cos(departure)
        velocity = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(departure)], axis=-1)
        hit = flat_fire_crossing(np.zeros_like(velocity), speed[:, None] * velocity, plane, np.asarray(MUZZLE["drag"]))
        return Shots(pitch, 0 * pitch, plane, measured, hit.lateral if lateral else None, "simulated", hit.height)
    distance = landing_distance(speed, departure, MUZZLE["height"], MUZZLE["drag"])
    return Shots(pitch, 0 * pitch, distance, measured, distance * np.sin(azimuth) if lateral else None, "simulated")


@pytest.fixture
def muzzle():
    return MUZZLE


@pytest.fixture
def fire():
    return fire_shots
