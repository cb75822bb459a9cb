"""A simulated SO-101 on a table with one block, which takes the joint positions that a real arm takes.

The environment is `SO101PickCube-v0` of the PyPI package `lerobot-env-so101`, on MuJoCo. Its own actions move the gripper in space. LeRobot's policies
for a real SO-101 give joint positions instead, so this file sets the six position actuators: five joints in degrees, and the gripper from 0
(closed) to 100 (open).
"""

import os
import sys
import types

# Without a display, MuJoCo draws by EGL. MUJOCO_GL=osmesa is the other way.
os.environ.setdefault("MUJOCO_GL", "egl")

try:
    import mujoco
    import numpy as np

    # The package registers itself with LeRobot 0.6 when it is imported, and LeRobot 0.4 has no place for that.
    sys.modules.setdefault("lerobot_env_so101.configuration_so101", types.ModuleType("configuration_so101"))
    from lerobot_env_so101 import SO101PickCubeGymEnv
    from lerobot_env_so101.policy import flatten_observation
    from lerobot_env_so101.scripted.reach_close import is_reach_close_success, scripted_reach_close
except ImportError as missing:
    raise SystemExit(
        f"error: the simulator is not installed: {missing}. Run `make rollout`, which installs scripts/rollout/requirements.txt into "
        "~/.cache/zk0/rollout, and start this script with the Python of that folder"
    ) from missing
except AttributeError as no_drawing:
    raise SystemExit(
        f"error: MuJoCo cannot draw with MUJOCO_GL={os.environ['MUJOCO_GL']}: {no_drawing}. Install libegl1 for MUJOCO_GL=egl, or libosmesa6 for "
        "MUJOCO_GL=osmesa"
    ) from no_drawing

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
TASK = "Reach the block and close the gripper."
CAMERA = "top"
SIDE = 128
FPS = 10
# Metres that the expert's hand moves in a step at most.
STRIDE = 0.025


class Arm(SO101PickCubeGymEnv):
    """The arm. `reset(seed=…)` places the block anywhere in a square of 20 cm; the same seed gives the same place."""

    def __init__(self):
        super().__init__(control_dt=1 / FPS, random_block_position=True, action_scale=STRIDE)
        self.model.vis.quality.offsamples = 0
        self._drawing = None

    def reset(self, seed):
        return super().reset(seed=seed)

    def positions(self):
        """Where the joints are: five in degrees, and the gripper from 0 to 100."""
        angles = [self.data.joint(name).qpos[0] for name in JOINTS]
        return self._in_units(np.array(angles))

    def targets(self):
        """Where the motors drive the joints to, in the same units."""
        return self._in_units(np.array([self.data.actuator(name).ctrl[0] for name in JOINTS]))

    def drive(self, targets):
        """Drives the joints to `targets` for one step."""
        self._aim(targets)
        for _ in range(self._n_substeps):
            mujoco.mj_step(self.model, self.data)

    def expert_targets(self):
        """What the package's scripted controller drives the joints to in this step. It knows where the block is."""
        steps, self._n_substeps = self._n_substeps, 0
        self.apply_action(scripted_reach_close(self._seen(), STRIDE))
        self._n_substeps = steps
        return self.targets()

    def succeeded(self):
        """The gripper is told to close, and is within 5 cm of the block."""
        return is_reach_close_success(self._seen())

    def distance(self):
        """Metres from the gripper to the block."""
        return float(np.linalg.norm(self.data.sensor("so101/ee_pos").data - self.data.sensor("block_pos").data))

    def picture(self):
        """What the camera above the table sees: 128 × 128 pixels, RGB."""
        if self._drawing is None:
            try:
                self._drawing = mujoco.Renderer(self.model, SIDE, SIDE)
            except Exception as failed:
                raise SystemExit(
                    f"error: MuJoCo cannot draw with MUJOCO_GL={os.environ['MUJOCO_GL']}: {failed}. Install libegl1 and libegl-mesa0 for "
                    "MUJOCO_GL=egl, or libosmesa6 for MUJOCO_GL=osmesa"
                ) from failed
            self._view = mujoco.MjvCamera()
            self._view.lookat[:] = (0.27, 0.0, 0.03)
            self._view.distance, self._view.azimuth, self._view.elevation = 0.62, 180.0, -65.0
            # The convex hulls that collide (group 3), instead of the arm's 300,000 triangles: where no GPU draws, that takes a quarter of the time.
            self._shown = mujoco.MjvOption()
            self._shown.geomgroup[:] = (1, 0, 0, 1, 0, 0)
            self._shown.flags[mujoco.mjtVisFlag.mjVIS_CONVEXHULL] = 1
        self._drawing.update_scene(self.data, self._view, self._shown)
        self._drawing.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._drawing.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        return self._drawing.render().copy()

    def close(self):
        super().close()
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None

    def _seen(self):
        return flatten_observation(self._compute_observation())

    def _gripper_range(self):
        return self.model.actuator("gripper").ctrlrange

    def _in_units(self, angles):
        closed, opened = self._gripper_range()
        gripper = 100 * (angles[5] - closed) / (opened - closed)
        return np.array([*np.degrees(angles[:5]), gripper], dtype=np.float32)

    def _aim(self, targets):
        closed, opened = self._gripper_range()
        angles = [*np.radians(np.asarray(targets[:5], dtype=np.float64)), closed + targets[5] / 100 * (opened - closed)]
        for name, angle in zip(JOINTS, angles):
            actuator = self.model.actuator(name)
            self.data.actuator(name).ctrl[0] = np.clip(angle, *actuator.ctrlrange)
