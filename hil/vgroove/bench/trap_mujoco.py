"""MuJoCo's system identification on the joint of `vgroove bench trap`: damping alone, and damping
with the friction added by hand.
"""

import time

import mujoco
import numpy as np
from mujoco import rollout, sysid
from mujoco.sysid.report.sections.insights import AutomatedInsights

from vgroove.bench import trap
from vgroove.bench.trap import Answer, Floats, Motion

JOINT = f"""
<mujoco>
  <option timestep="{1.0 / trap.LOG_HZ}" gravity="0 0 0" integrator="implicitfast">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="arm">
      <inertial pos="0 0 0" mass="1" diaginertia="{trap.INERTIA} {trap.INERTIA} {trap.INERTIA}"/>
      <joint name="joint" type="hinge" axis="0 0 1" damping="{trap.ASSUMED_DAMPING}"/>
    </body>
  </worldbody>
  <actuator><motor joint="joint"/></actuator>
  <sensor>
    <jointpos name="position" joint="joint"/>
    <jointvel name="velocity" joint="joint"/>
  </sensor>
</mujoco>
"""
# Start and bounds of each field
FIELDS = {"damping": (trap.ASSUMED_DAMPING, 0.0, 0.05), "frictionloss": (1e-3, 0.0, 0.5)}


def answers(train: Motion, new: Motion) -> list[Answer]:
    """Damping alone; damping and friction."""
    return [
        answer("MuJoCo sysid, damping", ("damping",), train, new),
        answer("MuJoCo sysid, friction added by hand", ("damping", "frictionloss"), train, new),
    ]


def answer(name: str, fields: tuple[str, ...], train: Motion, new: Motion) -> Answer:
    """The result of a fit of these fields of the joint."""
    start = time.process_time()
    fitted = fit(fields, train)
    busy = time.process_time() - start
    # the text of the report has no public getter
    printed = "; ".join(insight["title"] for insight in AutomatedInsights("", fitted)._insights)
    found = {field: float(np.ravel(fitted[field].value)[0]) for field in fields}
    error = trap.relative_error(free_run(found, new), new)
    return Answer(name, printed, found["damping"], found.get("frictionloss"), error, busy)


def fit(fields: tuple[str, ...], train: Motion) -> sysid.ParameterDict:
    """The joint's fields, fitted to angle and speed."""
    spec = mujoco.MjSpec.from_string(JOINT)
    model = spec.compile()
    parameters = sysid.ParameterDict()
    for field in fields:
        value, low, high = FIELDS[field]
        parameters.add(
            sysid.Parameter(
                field,
                nominal=value,
                min_value=low,
                max_value=high,
                modifier=lambda s, p, field=field: set_field(s, field, float(p.value[0])),
            )
        )
    begin = sysid.create_initial_state(model, np.zeros(1), np.zeros(1), np.zeros(0))
    sensors = sysid.TimeSeries.from_names(
        train.time_s, np.column_stack([train.angle_rad, train.speed_rad_s]), model
    )
    # held from the start of the row
    control = sysid.TimeSeries(train.time_s - 1.0 / trap.LOG_HZ, train.torque_nm[:, None])
    sequences = sysid.ModelSequences("joint", spec, "measured", begin, control, sensors)
    fitted, _ = sysid.optimize(
        initial_params=parameters,
        residual_fn=sysid.build_residual_fn(models_sequences=[sequences]),
        verbose=False,
    )
    return fitted


def set_field(spec: mujoco.MjSpec, field: str, value: float) -> None:
    """Set a field of the joint; in MuJoCo 4 the damping is a list of coefficients."""
    joint = spec.joint("joint")
    old = getattr(joint, field)
    setattr(joint, field, value if np.ndim(old) == 0 else [value] + [0.0] * (len(old) - 1))


def free_run(fields: dict[str, float], new: Motion) -> Floats:
    """Speed (n,) rad/s of the fitted joint under new torques, from rest."""
    spec = mujoco.MjSpec.from_string(JOINT)
    for field, value in fields.items():
        set_field(spec, field, value)
    model = spec.compile()
    data = mujoco.MjData(model)
    begin = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    state, _ = rollout.rollout(model, data, begin, np.ascontiguousarray(new.torque_nm[:, None]))
    return np.squeeze(state, axis=0)[:, 2]
