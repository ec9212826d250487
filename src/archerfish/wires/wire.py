"""The two directions of a wire: frames as reports of the robot, and commands as frames, by tables of a TOML file."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, TypeAlias

import msgspec
import numpy as np
from msgspec import field
from numpy.typing import NDArray

from archerfish.errors import InputError, file_error, meant
from archerfish.messages import Feedback, Numbers
from archerfish.plugins import find_plugin, names_code
from archerfish.records.json_files import Number, fault, read_toml
from archerfish.records.record import Struct, Text
from archerfish.wires.layout import Layout
from archerfish.wires.stream import WireFrame

_WIRES = Path(__file__).parent
_REMEDY = "correct it; a frame may have fields, endian, switch_on, sent.idle, sent.control and sent.fire"
_ANGLES = ("pitch", "yaw", "pitch_rate", "yaw_rate")
_COMMANDED = _ANGLES[:2]
_ENCODER = "yaw_encoder"
_NEAR = 0.75  # of difflib: "pich" is near to "pitch", and "switch" is not
_LARGEST = 1e3  # no angle [rad] and no rate [rad/s] of a gimbal is beyond it
_Numbers: TypeAlias = dict[str, Number]
_State: TypeAlias = Literal["idle", "control", "fire"]


class FrameTable(Struct, frozen=True, kw_only=True):
    """A frame in a wire's file."""

    fields: tuple[Text, ...]
    """As `Layout` takes them."""
    endian: Literal["little", "big"] = "little"
    """Of the numbers."""
    switch_on: _Numbers = field(default_factory=dict)
    """Numbers of a received frame by which the operator lets the computer aim."""
    sent: dict[_State, _Numbers] = field(default_factory=dict)
    """Numbers with which the computer sends the frame: while the gimbal is not to follow (idle), with a command that
    does not fire (control), and with one that fires; a frame without any is received."""


class WireReports(NamedTuple):
    """Reports of a robot, N of them."""

    feedback: Feedback  # of the gimbal, (N,); times are NaN where a wire has no stamps
    switch_on: NDArray[np.bool_] | None  # whether the operator lets the computer aim, (N,); None: no frame has it
    muzzle_speed: Numbers  # measured last [m/s], (N,); NaN where there is none
    shots_left: Numbers  # that heat allows, (N,); NaN where no report of it came since
    base_yaw: Numbers  # of the chassis, in [−π, π) [rad], (N,); NaN where the wire does not say it


class WireCommand(NamedTuple):
    """A command to a robot."""

    angle: Numbers  # pitch and yaw [rad], (2,)
    control: bool  # whether the gimbal is to follow; else it idles
    fire: bool  # whether to fire a pellet


class Wire(Protocol):
    """What a team writes whose frames no table covers; `load_wire` takes it."""

    @property
    def received(self) -> Sequence[Layout]:
        """Frames that the computer receives."""

    def decode(self, frames: Sequence[WireFrame]) -> WireReports:
        """Return the reports in some frames: radians, pitch with the muzzle up and yaw to the left positive.

        A wire whose reports have `base_yaw` says so by an attribute `has_base_yaw` that is true, one whose reports have
        `shots_left` by `has_heat`.
        """

    def encode(self, command: WireCommand) -> bytes:
        """Return the frames of a command."""


class TableWire:
    """A wire by tables.

    The numbers pitch, yaw, pitch_rate and yaw_rate of a received frame make a report. Where it has yaw_encoder, the yaw
    from the chassis, beside the yaw of a gyroscope, their difference is that of the chassis. muzzle_speed and
    shots_left are those of the latest frame that has them. Frames of a command have its pitch and yaw; the number
    sequence counts commands from 0 to 255, which every type holds.
    """

    def __init__(self, name: str, tables: dict[str, FrameTable]) -> None:
        """Read the tables of frames.

        Args:
          name: of the wire.
          tables: by the names of the frames.

        Raises:
          InputError: if a table can't be used.
        """
        self.name, self.tables = name, tables
        self.layouts = {frame: Layout(frame, table.fields, table.endian) for frame, table in tables.items()}
        self.received = [self.layouts[frame] for frame, table in tables.items() if not table.sent]
        reports = [layout for layout in self.received if {*_ANGLES} <= {*layout.names}]
        self.report = reports[0].name if reports else ""
        """Name of the frame that makes a report; "" where there is none."""
        self.has_base_yaw = any(_ENCODER in layout.names for layout in reports)
        """Whether reports have the yaw of the chassis."""
        self.has_heat = any("shots_left" in layout.names for layout in self.received)
        """Whether a frame says how many shots the heat limit allows."""
        self._has_switch = any(table.switch_on for table in tables.values())
        self._sent = 0
        self.restart()
        for frame, table in tables.items():
            for values in (table.switch_on, *table.sent.values()):
                self._encode(frame, values | {"sequence": 255})  # refuses numbers that are no part of the frame

    def restart(self) -> None:
        """Forget what was received."""
        self._switch, self._latest = False, {"muzzle_speed": np.nan, "shots_left": np.nan}

    def __repr__(self) -> str:
        return f"TableWire({self.name}: {', '.join(self.layouts)})"

    def check_complete(self) -> None:
        """Refuse a wire without reports or commands, of which a part of a robot's wire may consist.

        Raises:
          InputError: saying what is missing.
        """
        idle, control, fire = (self._sent_in(state) for state in ("idle", "control", "fire"))
        controlling, firing = ([self.layouts[frame] for frame in frames] for frames in (control, fire))
        fires = any(control.get(frame) != numbers for frame, numbers in fire.items())
        elsewhere = ", ".join(name for name, table in self.tables.items() if table.switch_on and name != self.report)
        problems = (
            _lacking(self.received, _ANGLES, "frame", "a report; join its file"),
            elsewhere and f"switch_on is in {elsewhere}, expected it in {self.report}, whose age is watched; move it",
            "no frame has sent.control, expected a command; join its file" * (not control),
            "no sent.fire differs from its sent.control, so no shot could be fired; write it" * (not fires),
            "no frame has sent.idle, so the gimbal could not be let go; write it" * (not idle),
            "sent.idle is the same as another state, so the gimbal could not be let go; change one"
            * (idle in (control, fire)),
            _lacking(controlling, _COMMANDED, "frame with sent.control", "a command; add both to one frame"),
            _lacking(firing, _COMMANDED, "frame with sent.fire", "the angles, too; add sent.fire to their frame"),
        )
        for problem in problems:
            if problem:
                raise InputError(f"wire {self.name}: {problem}")

    def decode(self, frames: Sequence[WireFrame]) -> WireReports:
        """Return the reports in some frames; see `Wire.decode`."""
        rows, switches = list[list[float]](), list[bool]()
        for frame in frames:
            values = frame.layout.decode(frame.data)
            switch_on = self.tables[frame.layout.name].switch_on
            if switch_on:
                self._switch = all(values[name] == value for name, value in switch_on.items())
            self._latest |= {name: values[name] for name in self._latest if name in values}
            if values.keys() >= {*_ANGLES}:
                angles_and_rates = [values[name] for name in _ANGLES]
                rows.append([*angles_and_rates, values.get(_ENCODER, np.nan), *self._latest.values()])
                self._latest["shots_left"] = np.nan
                switches.append(self._switch)
        columns = np.array(rows, float).reshape(-1, 7)
        angle, rate, encoder = columns[:, :2], columns[:, 2:4], columns[:, 4]
        with np.errstate(invalid="ignore"):  # infinite angles, which `in_range` refuses
            base_yaw = np.remainder(angle[:, 1] - encoder + np.pi, 2.0 * np.pi) - np.pi
        no_time = np.full(len(rows), np.nan)
        return WireReports(
            feedback=Feedback(no_time, no_time, angle, rate),
            switch_on=np.array(switches, bool) if self._has_switch else None,
            muzzle_speed=columns[:, 5],
            shots_left=columns[:, 6],
            base_yaw=base_yaw,
        )

    def encode(self, command: WireCommand) -> bytes:
        """Return the frames of a command; see `Wire.encode`."""
        state: _State = "idle"
        if command.control:
            state = "fire" if command.fire else "control"
        pitch, yaw = command.angle.tolist() if command.control else (0.0, 0.0)
        usual = {"pitch": pitch, "yaw": yaw, "sequence": self._sent % 256}
        self._sent += 1
        return b"".join(self._encode(frame, usual | numbers) for frame, numbers in self._sent_in(state).items())

    def _sent_in(self, state: _State) -> dict[str, _Numbers]:
        """Return the frames that are sent in a state, with their numbers."""
        return {frame: table.sent[state] for frame, table in self.tables.items() if state in table.sent}

    def _encode(self, frame: str, values: _Numbers) -> bytes:
        """Encode numbers, of which a frame may lack the usual ones."""
        layout = self.layouts[frame]
        left_out = {"pitch", "yaw", "sequence"} - {*layout.names}
        return layout.encode({name: value for name, value in values.items() if name not in left_out})


def load_wire(*wires: str | Path | Wire) -> Wire:
    """Read a wire.

    Args:
      wires: names of those that come with Archerfish, or TOML files, whose frames are joined; or one of a team's own:
        ./FILE.py:NAME, or the object, with `received`, `decode` and `encode`.

    Raises:
      InputError: naming file and field, if there is no such wire or it can't be used.
    """
    if not wires:
        raise InputError("wires: expected one or more, got none; name one, such as sp_vision_25")
    [first, *others] = wires
    if not isinstance(first, str | Path) or names_code(str(first)):
        return _own_wire(first, others)
    tables, names = dict[str, FrameTable](), list[str]()
    for path, own in map(_read_tables, wires):
        if twice := own.keys() & tables.keys():
            raise file_error(path, f"frame {min(twice)} is in another file, too", "rename it in one of them")
        tables |= own
        names.append(path.stem)
    return TableWire("+".join(names), tables)


def check_shapes(reports: WireReports) -> None:
    """Refuse reports of a wire of one's own whose arrays have other shapes than `WireReports` says.

    Raises:
      InputError: naming the array.
    """
    feedback, *others = reports
    size = np.size(feedback.sampled_s)
    for name, array in zip((*Feedback._fields, *WireReports._fields[1:]), (*feedback, *others), strict=True):
        shape = (size, 2) if name in ("angle", "rate") else (size,)
        got = getattr(array, "shape", type(array).__name__)
        if got != shape and not (name == "switch_on" and array is None):
            raise InputError(f"decode: {name}: expected an array of shape {shape} for {size} reports, got {got}")


def in_range(feedback: Feedback) -> NDArray[np.bool_]:
    """Return which reports have angles and rates that a gimbal may have, shape (N,)."""
    numbers = np.concatenate([feedback.angle, feedback.rate], axis=-1)
    is_pitch = np.abs(feedback.angle[:, 0]) <= np.pi
    return np.asarray(is_pitch & np.all(np.abs(numbers) < _LARGEST, axis=-1))  # false for NaN


def _own_wire(wire: str | Path | Wire, others: Sequence[object]) -> Wire:
    """Return a wire of a team's own."""
    plugin = find_plugin(str(wire) if isinstance(wire, Path) else wire, "wire")
    with plugin.running():
        value = plugin.value() if isinstance(plugin.value, type) else plugin.value
        if missing := [name for name in ("received", "decode", "encode") if not hasattr(value, name)]:
            raise InputError(f"{type(value).__name__} has no {', '.join(missing)}, expected a wire; write them")
        if others:
            raise InputError(f"a wire in Python has all frames of the robot, got {others[0]}, too; leave that out")
        own: Wire = value
        # The computer counts what it can't decode and goes on: what is wrong for every frame is refused here.
        check_shapes(own.decode([WireFrame(layout, layout.encode({})) for layout in own.received]))
        return own


def _lacking(layouts: Sequence[Layout], expected: Sequence[str], frames: str, what: str) -> str:
    """Return what is missing where no frame has all of some numbers; nothing where one has.

    Args:
      layouts: of the frames.
      expected: names of the numbers.
      frames: which frames those are.
      what: is expected of one, with what to do where none has any of the numbers.
    """
    lacks = {layout: [name for name in expected if name not in layout.names] for layout in layouts}
    nearest = min(layouts, key=lambda layout: len(lacks[layout]), default=None)
    if nearest is None or len(lacks[nearest]) == len(expected):
        return f"no {frames} has {', '.join(expected)}, expected {what}"
    missing = lacks[nearest]
    if not missing:
        return ""
    others, remedies = [name for name in nearest.names if name not in expected], list[str]()
    for name in missing:
        if near := difflib.get_close_matches(name, others, 1, _NEAR):
            remedies.append(f"for {near[0]} perhaps you meant {name}")
    return f"frame {nearest.name} has no {', '.join(missing)}; {', '.join(remedies) or 'add what is missing'}"


def _read_tables(wire: object) -> tuple[Path, dict[str, FrameTable]]:
    """Return the file of a wire, and its frames."""
    known = {path.stem: path for path in sorted(_WIRES.glob("*.toml"))}
    path = known.get(str(wire), Path(str(wire)))
    if path.suffix == ".py":
        raise file_error(path, "expected the name of a wire in it", f"add :NAME, as {wire}:NAME")
    if path.suffix != ".toml":
        remedy = meant(str(wire), known, f"known are {', '.join(known)}, or give a TOML file or ./FILE.py:NAME")
        raise InputError(f"there is no wire {str(wire)!r}; {remedy}")
    tables = dict[str, FrameTable]()
    for frame, content in read_toml(path, "correct that place").items():
        try:
            tables[frame] = msgspec.convert(content, FrameTable)
        except msgspec.ValidationError as error:
            raise file_error(path, fault(error, content, frame, FrameTable), _REMEDY) from error
    try:
        TableWire(path.stem, tables)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return path, tables
