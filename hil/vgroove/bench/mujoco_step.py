"""What a step of MuJoCo costs for a tool of the same parts; a step cost only: soft constraints
stand for groove and steel.
"""

import time

import mujoco

STEP_S = 2e-5  # lugs of steel would need a shorter one

# Spindle, hammer (turning and sliding on it, tied to its groove by a polynomial x = f(q), spring),
# anvil with a joint of dry friction.
MODEL = f"""
<mujoco>
  <option timestep="{STEP_S}" integrator="implicitfast" gravity="0 0 0" cone="elliptic"/>
  <worldbody>
    <body name="spindle">
      <inertial pos="0 0 0" mass="0.1" diaginertia="6e-6 6e-6 6e-6"/>
      <joint name="spindle" type="hinge" axis="0 0 1" armature="5.0e-4" damping="1.4e-4" frictionloss="0.067"/>
      <body name="hammer">
        <inertial pos="0 0 0" mass="0.19" diaginertia="4.5e-5 4.5e-5 4.5e-5"/>
        <joint name="x" type="slide" axis="0 0 -1" stiffness="29400" springref="-0.00748"/>
        <joint name="q" type="hinge" axis="0 0 -1" range="-2.8 2.8" limited="true"/>
        <geom type="box" condim="1" size="0.004 0.004 0.00225" pos="0.015 0 0.00225" solref="0.0001 1"/>
        <geom type="box" condim="1" size="0.004 0.004 0.00225" pos="-0.015 0 0.00225" solref="0.0001 1"/>
      </body>
    </body>
    <body name="anvil">
      <inertial pos="0 0 0" mass="0.1" diaginertia="1.2e-5 1.2e-5 1.2e-5"/>
      <joint name="anvil" type="hinge" axis="0 0 1" frictionloss="60" solreffriction="0.0001 1"/>
      <geom type="box" condim="1" size="0.004 0.004 0.00225" pos="0 0.015 0.00226" solref="0.0001 1"/>
      <geom type="box" condim="1" size="0.004 0.004 0.00225" pos="0 -0.015 0.00226" solref="0.0001 1"/>
    </body>
  </worldbody>
  <equality><joint joint1="x" joint2="q" polycoef="0 0 0.0044 0 0" solref="0.0001 1" solimp="0.999 0.9999 0.0001"/></equality>
  <actuator><general joint="spindle" gainprm="3.89" biastype="affine" biasprm="0 0 -0.0128" ctrlrange="0 1"/></actuator>
</mujoco>
"""


def seconds_per_step(steps: int = 5000) -> float:
    """Wall seconds of one mj_step at full drive, after a warm-up of as many."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data, steps)
    start = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    return (time.perf_counter() - start) / steps
