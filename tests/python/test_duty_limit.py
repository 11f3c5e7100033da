"""The setpoint duty_limit bounds the duty of every mode, under impacts and in pulse mode."""

from dataclasses import replace

import numpy as np
import pytest

from vgroove import lockstep, telemetry
from vgroove.log import Log, log_from_stream
from vgroove.scenario import Command, Scenario, command_messages, make_plant
from vgroove.sil import SilBoard
from vgroove.study.fixed_point import MODES, drill_scenario, impact_scenario

LIMIT = 0.3
STEP = 1.0 / 255.0  # of the bridge
LIMITED = Command(0.06, "SETPOINT", {"setpoint_which": 0, "setpoint_value": round(LIMIT * 2**15)})


def limited_log(scenario: Scenario, *further: Command) -> Log:
    """Log of a run with the duty limit."""
    commands = (*scenario.commands, LIMITED, *further)
    line = lockstep.Script(command_messages(commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    tool = make_plant(scenario.tool, scenario.seed)
    sent = lockstep.run(SilBoard(), tool, scenario.profile, scenario.duration_s, options)
    return log_from_stream(sent, "board")


@pytest.mark.parametrize("mode", [m for m, name in enumerate(MODES) if name != "drill"])
def test_no_duty_of_the_impact_driver_exceeds_the_limit(mode: int) -> None:
    scenario = replace(impact_scenario(mode, "hard_joint", 1.0, 18.0, 1), duration_s=1.1)
    duty = limited_log(scenario)["duty"]
    assert LIMIT - 2 * STEP < np.nanmax(duty) <= LIMIT + STEP / 2


def test_no_duty_of_pulse_mode_exceeds_the_limit() -> None:
    names = [parameter.name for parameter in telemetry.parameter_list()]
    pulse = {"write_index": names.index("drill_pulse"), "write_value": 1}
    scenario = drill_scenario("drill_driver_low", 6.0, 1.0, 18.0, 1)
    duty = limited_log(scenario, Command(0.12, "PARAM_WRITE", pulse))["duty"]
    assert LIMIT - 2 * STEP < np.nanmax(duty) <= LIMIT + STEP / 2
