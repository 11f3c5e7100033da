"""Cost of a step of MuJoCo for a tool with the parts of the reference tool.

Only the cost is compared: MuJoCo's soft constraints stand for the groove and the steel contacts.
"""

import time

import mujoco

from vgroove.bench.impact_tool import SLIPPING, ImpactTool

STEP_S = 2e-5  # an accurate run with contacts of steel would need a shorter one
STEPS = 5000
LUG_HALF_M = 0.004  # half width of a lug
MASS_KG = 0.1  # of spindle and anvil, which only turn


def model_of(tool: ImpactTool) -> str:
    """MJCF of a tool on a joint that slips: spindle, hammer (it turns and slides on the spindle,
    tied to the groove by the polynomial x = f(q), against the spring), and anvil with dry friction.
    """
    motor_inertia = tool.ratio**2 * tool.motor_inertia
    damping, friction = tool.ratio**2 * tool.viscous, tool.ratio * tool.coulomb_nm
    resistance, k = tool.resistance_ohm + tool.supply_ohm, tool.ratio * tool.torque_constant
    lug_half_m, radius = 0.5 * tool.lug_height_m, tool.lug_radius_m
    lug = f'size="{LUG_HALF_M} {LUG_HALF_M} {lug_half_m}" solref="0.0001 1"'
    turning = "{0} {0} {0}".format
    return f"""
<mujoco>
  <option timestep="{STEP_S}" integrator="implicitfast" gravity="0 0 0" cone="elliptic"/>
  <worldbody>
    <body name="spindle">
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{turning(tool.spindle_inertia)}"/>
      <joint name="spindle" type="hinge" axis="0 0 1" armature="{motor_inertia}"
             damping="{damping}" frictionloss="{friction}"/>
      <body name="hammer">
        <inertial pos="0 0 0" mass="{tool.hammer_kg}"
                  diaginertia="{turning(tool.hammer_inertia)}"/>
        <joint name="x" type="slide" axis="0 0 -1" stiffness="{tool.rate_n_m}"
               springref="{-tool.preload_n / tool.rate_n_m}"/>
        <joint name="q" type="hinge" axis="0 0 -1" range="{-tool.travel_rad} {tool.travel_rad}"
               limited="true"/>
        <geom type="box" condim="1" {lug} pos="{radius} 0 {lug_half_m}"/>
        <geom type="box" condim="1" {lug} pos="{-radius} 0 {lug_half_m}"/>
      </body>
    </body>
    <body name="anvil">
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{turning(tool.anvil_inertia)}"/>
      <joint name="anvil" type="hinge" axis="0 0 1" frictionloss="{tool.run_nm}"
             solreffriction="0.0001 1"/>
      <geom type="box" condim="1" {lug} pos="0 {radius} {lug_half_m + tool.ramp_m}"/>
      <geom type="box" condim="1" {lug} pos="0 {-radius} {lug_half_m + tool.ramp_m}"/>
    </body>
  </worldbody>
  <equality>
    <joint joint1="x" joint2="q" polycoef="0 0 {tool.lead_m} 0 0" solref="0.0001 1"
           solimp="0.999 0.9999 0.0001"/>
  </equality>
  <actuator>
    <general joint="spindle" gainprm="{k * tool.supply_v / resistance}" biastype="affine"
             biasprm="0 0 {-(k**2) / resistance}" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""


def seconds_per_step(steps: int = STEPS) -> float:
    """Wall seconds of one mj_step at full duty, after a warm-up of as many steps."""
    model = mujoco.MjModel.from_xml_string(model_of(SLIPPING["slip_60"]))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data, steps)
    start = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    return (time.perf_counter() - start) / steps
