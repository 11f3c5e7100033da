"""One run of the firmware on the plant: mode and parameters by name in, telemetry and the plant's
states out.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np

from vgroove import _core, lockstep, telemetry
from vgroove.eeprom_image import AbsentError, eeprom_image, mode_number
from vgroove.errors import VgrooveError
from vgroove.lockstep import FrontEnds, Profile
from vgroove.reference.blows import BLOW, REBOUND
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import DRIVE_ALONE, reference_rig, with_load
from vgroove.rig import Rig
from vgroove.scenario import CURRENT_SAMPLES_PER_ROW, SUPPLY_SAMPLES_PER_ROW
from vgroove.sil import SilBoard
from vgroove.units import TURN_RAD

PULL_S = 0.25  # of the trigger: the firmware has measured its current offset before
PULL_RAMP_S = 0.02
STATE_BYTES = 2000  # the first STATE frame is among so many bytes
FLAG_DEFAULTS = 256  # STATE.flags, param_defaults: firmware/telemetry/vgroove.dbc
# A blow as the native firmware reports it; `repeats` counts for each lug.
REPORTED = ("time_s", "lugs", "repeats", "period_s", "mean_period_s", "spread")


def reference(
    joint: str | Mapping[str, Any] = "locked",
    values: Mapping[str, float] | None = None,
    *,
    supply_v: float | None = None,
) -> Rig:
    """The reference tool on one of vgroove.reference.joints.REFERENCE_JOINTS, or on a section
    [load]; `values` are other dotted keys.
    """
    load = REFERENCE_JOINTS[joint].load if isinstance(joint, str) else joint
    supply = {} if supply_v is None else {"supply.voltage_v": supply_v}
    return with_load(reference_rig(), load, {**supply, **(values or {})})


def pull(trigger: float = 1.0, release_s: float | None = None, at_s: float = PULL_S) -> Profile:
    """The trigger is pulled at at_s to a travel of 0..1, and released at release_s, if given."""
    points = [(0.0, 0.0), (at_s, 0.0), (at_s + PULL_RAMP_S, trigger)]
    if release_s is not None:
        points += [(release_s, trigger), (release_s + PULL_RAMP_S, 0.0)]
    return Profile(travel=points)


@cache
def sensors() -> Mapping[str, float]:
    """Section [sensors] of the reference drive: noise of a row (1 sigma), edges of the Hall
    sensor.
    """
    return reference_rig(DRIVE_ALONE).sensors


def front_ends(noise: bool = True) -> FrontEnds:
    """The sensors of the bench: noise of single samples, of which a row averages several."""
    share = 1.0 if noise else 0.0
    return FrontEnds(
        current_noise_a=share * sensors()["current_noise_a"] * CURRENT_SAMPLES_PER_ROW**0.5,
        supply_noise_v=share * sensors()["supply_noise_v"] * SUPPLY_SAMPLES_PER_ROW**0.5,
    )


@dataclass(frozen=True)
class Run:
    """A finished run. Times count from the board's start; `tool` is the plant at the end of the
    run.

    blows: of the plant: time_s, approach_rad_s, engaged_m, impulse_nm_s, peak_torque_nm, kind (0
    blow, 1 repeat, 2 rebound), lug, skipped. reported: (n, len(REPORTED)), the blows that the
    native firmware reports; none from another board.
    """

    rig: Rig
    tool: Any
    sent: bytes
    duration_s: float
    blows: np.ndarray = field(repr=False)
    truth_rows: np.ndarray | None = field(repr=False, default=None)
    reported: np.ndarray = field(repr=False, default_factory=lambda: np.zeros((0, len(REPORTED))))

    @property
    def hits(self) -> np.ndarray:
        """Blows and repeats; a rebound is part of its blow."""
        return self.blows[self.blows["kind"] < REBOUND]

    @property
    def struck_s(self) -> np.ndarray:
        """Times (n,) of the blows, repeats excluded."""
        return self.hits["time_s"][self.hits["kind"] == BLOW]

    @cached_property
    def truth(self) -> dict[str, np.ndarray]:
        """Columns of vgroove._core.TRUTH_COLUMNS, (n,) each; duty is NaN where the bridge was open.

        Raises VgrooveError for a run without truth_every.
        """
        if self.truth_rows is None:
            raise VgrooveError("this run kept no states of the plant: truth_every is needed")
        return dict(zip(_core.TRUTH_COLUMNS, self.truth_rows.T, strict=True))

    @cached_property
    def frames(self) -> list[telemetry.Frame]:
        """Intact frames in the order of their arrival."""
        return telemetry.Framer().feed(self.sent)

    @cached_property
    def session(self) -> telemetry.Session:
        """Boot message, parameters and counters."""
        session = telemetry.Session()
        session.feed(self.frames)
        return session

    @cached_property
    def telemetry(self) -> dict[str, np.ndarray]:
        """time_s and telemetry.COLUMNS, (n,) each."""
        return self.session.take_rows()

    def signals(self, message: str) -> dict[str, np.ndarray]:
        """Signals of all frames of a message and their time_s, (n,) each; without frames the arrays
        are empty.
        """
        messages = {m.name: m for m in telemetry.database().messages}
        if message not in messages:
            return {"time_s": np.zeros(0)}
        frames = [frame for frame in self.frames if frame.id == messages[message].frame_id]
        return {
            "time_s": np.array([frame.time_ms for frame in frames]) / 1000,
            **telemetry.decode_many(message, frames),
        }

    @cached_property
    def control(self) -> dict[str, np.ndarray]:
        """CONTROL frames: state, stop reason, blow count, period, estimate."""
        return self.signals("CONTROL")

    @property
    def faults(self) -> int:
        """Fault bits that were set at any time."""
        return int(np.bitwise_or.reduce(self.signals("STATE")["faults"].astype(int)))

    def slip_nm(self, head_rad: np.ndarray | float) -> np.ndarray:
        """Slip torque (n,) in N m of the joint at head angles from the run's start."""
        angles = np.atleast_1d(np.asarray(head_rad, float))
        return _core.joint_slip_torques(self.rig.parameters(), self.rig.load["kind"], angles)[0]

    @property
    def tightened_nm(self) -> float:
        """Slip torque of the joint in N m at the end of the run."""
        return float(self.slip_nm(self.tool.head_rad)[0])

    @property
    def seat_rad(self) -> float:
        """Head angle of a wood screw's head contact, from the run's start."""
        return TURN_RAD * (self.rig.load["turns"] - self.rig.load["from_turns"])


def passing_s(run: Run, angle_rad: float) -> float | None:
    """Time at which the head first reaches an angle; None where it does not."""
    there = np.flatnonzero(run.truth["head_rad"] >= angle_rad)
    return float(run.truth["time_s"][there[0]]) if len(there) else None


@dataclass(frozen=True)
class RunPlan:
    """Everything of a run but its tool.

    profile: trigger, direction and load over time; by default the trigger is pulled fully at
    PULL_S. mode: a name of STATE.mode in the signal list. params: physical values by name, written
    into the EEPROM before the start. seed: of the sensors' noise and of the position of the Hall
    sensor on the shaft. truth_every: PWM periods from one kept state of the plant to the next; 0
    keeps none. stop_when: called with (tool, Progress) after each 16 ms; True ends the run. board:
    makes a board from the EEPROM image, in place of the native firmware.
    """

    profile: Profile = field(default_factory=pull)
    mode: str | int = "duty"
    params: Mapping[str, float] = field(default_factory=dict)
    duration_s: float = 1.5
    seed: int = 1
    truth_every: int = 0
    noise: bool = True
    stop_when: Callable[[Any, Any], bool] | None = None
    board: Callable[[bytes], Any] | None = None
    torque_map: bytes | None = None


def sil_run(rig: Rig, **plan: Any) -> Run:
    """The native firmware on a rig from switching on; the options are the fields of RunPlan.

    Raises AbsentError for a mode or a parameter that this firmware does not have.
    """
    return run_plan(rig, RunPlan(**plan))


def run_plan(rig: Rig, plan: RunPlan) -> Run:
    """The run of a plan on a rig; AbsentError as for sil_run."""
    number = mode_number(plan.mode)
    image = eeprom_image({**plan.params, "mode": number})
    tool = make_tool(rig, plan.seed)
    truth = _core.Truth(plan.truth_every) if plan.truth_every else None
    with make_board(plan, image) as machine:
        steps = lockstep.steps(
            machine,
            tool,
            plan.profile,
            plan.duration_s,
            lockstep.LockstepOptions(front=front_ends(plan.noise), seed=plan.seed, truth=truth),
        )
        for progress in steps:
            if plan.stop_when is not None and plan.stop_when(tool, progress):
                break
        reported = reported_blows(machine)
    sent = bytes(progress.sent)
    check_start(sent, plan.mode, number)
    blows = tool.blows() if hasattr(tool, "blows") else np.zeros(0)
    return Run(rig, tool, sent, progress.time_s, blows, truth.rows if truth else None, reported)


def make_board(plan: RunPlan, image: bytes) -> Any:
    """The plan's board with this EEPROM image."""
    if plan.board:
        return plan.board(image)
    return SilBoard(eeprom=image, torque_map=plan.torque_map)


def reported_blows(board: Any) -> np.ndarray:
    """Blows (n, len(REPORTED)) that the native firmware reports; none from another board."""
    blows = board.machine.blows if isinstance(board, SilBoard) else []
    return np.array(blows, float).reshape(-1, len(REPORTED))


def check_start(sent: bytes, mode: str | int, number: int) -> None:
    """Check that the board read the EEPROM and has the mode; AbsentError or VgrooveError
    otherwise.
    """
    frames = telemetry.Framer().feed(sent[:STATE_BYTES])
    states = [frame for frame in frames if frame.id == telemetry.STATE]
    if not states:
        raise VgrooveError("the board sent no frame STATE")
    state = telemetry.decode(states[0])
    if int(state["flags"]) & FLAG_DEFAULTS:
        raise VgrooveError(
            "the firmware rejected the parameters: its list differs from that of Python; "
            "run `pip install -e .` again"
        )
    if int(state["mode"]) != number:
        raise AbsentError(f"this firmware does not have mode {mode}")


def make_tool(rig: Rig, seed: int) -> Any:
    """The rig as a lock-step plant with its Hall sensor, where it states none that of the reference
    drive; the seed draws the sensor's position on the shaft.
    """
    pulses = rig.sensors.get("hall_pulses_per_rev") or sensors()["hall_pulses_per_rev"]
    hall = {
        "hall_pulses_per_rev": int(pulses),
        "hall_offset_rad": float(np.random.default_rng(seed).uniform(0.0, TURN_RAD)),
    }
    if rig.mechanism["kind"] == "drill_driver":
        pack_ohm = rig.value("supply.resistance_ohm")
        return _core.DrillPlant(rig.drill_parameters(), pack_ohm, **hall)
    kind = {"none": _core.DrivePlant, "impact": _core.ImpactPlant}[rig.mechanism["kind"]]
    return kind(rig.parameters(), load_kind=rig.load["kind"], seed=seed, **hall)
