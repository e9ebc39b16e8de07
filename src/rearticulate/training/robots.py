"""Robots to train on: what some packages of the Python Package Index hold under licences that allow it.

The robots of the benchmarks are never among them, in no version and as no part of another one: see EXCLUDED. Nothing is
downloaded here; a robot whose package is not installed is left out. Some packages come with
`pip install 'rearticulate[train]'`. The others ask for much that their meshes do not need, or are built for one old
Python only, and are installed as data, into any folder that Python imports from:

    pip install --no-deps fourier-robot-descriptions==0.2.7 hello-robot-stretch-urdf==0.1.2 \\
        robot-properties-fingers==2.0.2
    pip install --no-deps --target FOLDER --only-binary :all: --platform manylinux2014_x86_64 \\
        --python-version 3.11 pybullet==3.2.7
    pip install --no-deps --target FOLDER --only-binary :all: --platform manylinux1_x86_64 \\
        --python-version 3.7 roboschool==1.0.49
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rearticulate.errors import InputError
from rearticulate.synth.articulated import ArticulatedObject
from rearticulate.synth.urdf import load_urdf

MERGE_BELOW = 0.0125  # share of the surface below which a part is merged with its parent

EXCLUDED = (
    "panda", "franka", "fr3", "cassie", "spot", "nao", "kinova", "jaco", "gen3", "ur3", "ur5", "ur10", "bolt",
    "allegro", "barrett", "reachy", "icub", "jvrc", "a1", "solo", "anymal", "go1", "go2", "b1", "b2", "aliengo", "hyq",
    "tiago", "xarm", "alexander", "phantomx", "widowx", "viperx", "g1", "so100", "so101",
)  # fmt: skip


@dataclass(frozen=True)
class Robot:
    """Where a robot is.

    package: its name on the Python Package Index. urdf: its file, below a folder that Python imports from.
    licence: what its own files say, or else its package. alias: the name in package:// of the folder above the URDF's,
    where that has another name.
    """

    name: str
    package: str
    urdf: str
    licence: str
    alias: str = ""

    @property
    def path(self) -> Path | None:
        """The URDF, if its package is installed."""
        candidates = (Path(folder) / self.urdf for folder in sys.path)
        return next((path for path in candidates if path.is_file()), None)


def training_robots() -> dict[str, ArticulatedObject]:
    """All robots of the catalogue whose package is installed, by name."""
    found = [robot for robot in CATALOGUE if robot.path is not None]
    if not found:
        raise InputError('none of the robots to train on is installed: pip install "rearticulate[train]"')
    return {robot.name: load_robot(robot) for robot in found}


def load_robot(robot: Robot) -> ArticulatedObject:
    """The object that a robot of the catalogue is."""
    path = robot.path
    if path is None:
        raise InputError(f"{robot.name} needs the package {robot.package}: see rearticulate.training.robots")
    folders = [path.parents[1], path.parents[len(Path(robot.urdf).parts) - 2]]  # its own, and all of the package
    if not robot.alias:
        return load_urdf(path, package_dirs=folders, merge_below=MERGE_BELOW)
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        here = path.parents[1].as_posix()
        copy.write_text(path.read_text(encoding="utf-8").replace(f"package://{robot.alias}", here), encoding="utf-8")
        return load_urdf(copy, package_dirs=folders, merge_below=MERGE_BELOW)


def _example(name: str, urdf: str, licence: str) -> Robot:
    return Robot(name, "example-robot-data", f"cmeel.prefix/share/example-robot-data/robots/{urdf}", licence)


def _rtb(name: str, folder: str, urdf: str, alias: str) -> Robot:
    return Robot(name, "rtb-data", f"rtbdata/xacro/{folder}/urdf/{urdf}", "MIT", alias)


def _fourier(name: str, urdf: str) -> Robot:
    path = f"fourier_robot_descriptions/assets/urdf/{urdf}"
    return Robot(name, "fourier-robot-descriptions", path, "Apache-2.0")


def _finger(name: str, urdf: str) -> Robot:
    return Robot(name, "robot-properties-fingers", f"robot_properties_fingers/urdf/{urdf}", "BSD-3-Clause")


CATALOGUE = (
    Robot("Atlas", "roboschool", "roboschool/models_robot/atlas_description/urdf/atlas_v4_with_multisense.urdf", "MIT"),
    Robot("Fetch", "roboschool", "roboschool/models_robot/fetch_description/robots/fetch.urdf", "MIT"),
    _example("Baxter", "baxter_description/urdf/baxter.urdf", "BSD-3-Clause"),
    _example("Laikago", "laikago_description/urdf/laikago.urdf", "MPL-2.0"),
    _example("Talos", "talos_data/robots/talos_full_v2.urdf", "Apache-2.0"),
    _example("Romeo", "romeo_description/urdf/romeo.urdf", "BSD-3-Clause"),
    _example("Centauro", "centauro_description/urdf/centauro.urdf", "Apache-2.0"),
    _example("PR2", "pr2_description/urdf/pr2.urdf", "BSD-3-Clause"),
    _example("Human", "human_description/robots/human.urdf", "BSD-2-Clause"),
    _example("Hextilt", "hextilt_description/urdf/hextilt_flying_arm_5.urdf", "BSD-2-Clause"),
    _example("Z1", "z1_description/urdf/z1.urdf", "MPL-2.0"),
    _rtb("iiwa", "kuka_description/kuka_lbr_iiwa", "lbr_iiwa_14_r820.urdf", "kuka_lbr_iiwa_support"),
    _rtb("KR16", "kuka_description/kuka_kr16", "kr16_2.urdf", "kuka_kr16_support"),
    _rtb("KR120", "kuka_description/kuka_kr120", "kr120r2500pro.urdf", "kuka_kr120_support"),
    _rtb("Puma560", "unimation_puma560_description", "puma560_robot.urdf", ""),
    Robot("Vega", "dexmate-urdf", "dexmate_urdf/robots/humanoid/vega_1p/vega_1p_gripper.urdf", "Apache-2.0"),
    Robot("F5D6", "dexmate-urdf", "dexmate_urdf/robots/hands/f5d6_hand/f5d6_left.urdf", "Apache-2.0"),
    Robot("Robotiq2F85", "airo-models", "airo_models/grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf", "MIT"),
    _fourier("GR1T1", "gr1t1.urdf"),
    _fourier("GR2", "gr2t2.urdf"),
    _fourier("GR3", "gr3.urdf"),
    _fourier("Qinglong", "qinglong.urdf"),
    _fourier("FourierHand", "fourier_left_hand_12dof.urdf"),
    _fourier("InspireHand", "inspire_right_hand.urdf"),
    _finger("TriFinger", "trifinger.urdf"),
    _finger("TriFingerPro", "pro/trifingerpro.urdf"),
    _finger("TriFingerEdu", "edu/trifingeredu.urdf"),
    Robot("Stretch", "hello-robot-stretch-urdf",
          "stretch_urdf/SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf", "BSD-3-Clause-Clear"),
    Robot("Minitaur", "pybullet", "pybullet_data/quadruped/minitaur.urdf", "BSD-2-Clause"),
    Robot("Microtaur", "pybullet", "pybullet_data/quadruped/microtaur/microtaur.urdf", "BSD-2-Clause"),
    Robot("Vision60", "pybullet", "pybullet_data/quadruped/vision60.urdf", "MIT"),
)  # fmt: skip
