"""VRChain: visual homing for teams of robots that share what they see through a ledger.

    import vrchain as vr

    scene = vr.load_scene(vr.SCENES / "suburb.yaml")
    vr.plots.scene_map(scene)

The names below are what a notebook or a script needs. docs/reference/api.md has a line and an
example for each. Each is loaded when it is first used: importing the package loads no library.
"""

from typing import TYPE_CHECKING

from vrchain.lazy import lazy

if TYPE_CHECKING:
    from vrchain import play as play
    from vrchain import plots as plots
    from vrchain.errors import LedgerError as LedgerError
    from vrchain.errors import VRChainError as VRChainError
    from vrchain.experiments.landmarks.pairs import draw_pairs as draw_pairs
    from vrchain.experiments.ledger import tampering as tampering
    from vrchain.experiments.reproduction.results import Results as Results
    from vrchain.geometry import Pose as Pose
    from vrchain.landmarks.matching.common import Comparison as Comparison
    from vrchain.landmarks.matching.variants import Variant as Variant
    from vrchain.ledger import Ledger as Ledger
    from vrchain.ledger import random_key as random_key
    from vrchain.ledger import simulated_key as simulated_key
    from vrchain.ledger import verify as verify
    from vrchain.ledger import verify_proof as verify_proof
    from vrchain.ledger.export import entry_json as entry_json
    from vrchain.navigation.settings import MissionConfig as MissionConfig
    from vrchain.panorama import CameraRig as CameraRig
    from vrchain.panorama import Panorama as Panorama
    from vrchain.panorama import import_panorama as import_panorama
    from vrchain.panorama import view_change as view_change
    from vrchain.panorama.cameras import Source as Source
    from vrchain.panorama.spheres import equirectangular_jpeg as equirectangular_jpeg
    from vrchain.paths import SCENES as SCENES
    from vrchain.simulation.mission import run_mission as run_mission
    from vrchain.simulation.sightings import team_sightings as team_sightings
    from vrchain.simulation.survey import survey as survey
    from vrchain.viewer import view as view
    from vrchain.workbench import common_landmarks as common_landmarks
    from vrchain.workbench import figure as figure
    from vrchain.workbench import home_vector as home_vector
    from vrchain.workbench import load_database as load_database
    from vrchain.workbench import reproduced as reproduced
    from vrchain.workbench import watch as watch
    from vrchain.workbench import why as why
    from vrchain.world import Scene as Scene
    from vrchain.world import load_scene as load_scene
    from vrchain.world.render import Renderer as Renderer
    from vrchain.world.truth import GroundTruth as GroundTruth

__version__ = "0.1.0"

_HOMES = {
    "CameraRig": "panorama",
    "Comparison": "landmarks.matching.common",
    "GroundTruth": "world.truth",
    "Ledger": "ledger",
    "LedgerError": "errors",
    "MissionConfig": "navigation.settings",
    "Panorama": "panorama",
    "Pose": "geometry",
    "Renderer": "world.render",
    "Results": "experiments.reproduction.results",
    "SCENES": "paths",
    "Scene": "world",
    "Source": "panorama.cameras",
    "VRChainError": "errors",
    "Variant": "landmarks.matching.variants",
    "common_landmarks": "workbench",
    "draw_pairs": "experiments.landmarks.pairs",
    "entry_json": "ledger.export",
    "equirectangular_jpeg": "panorama.spheres",
    "figure": "workbench",
    "home_vector": "workbench",
    "import_panorama": "panorama",
    "load_database": "workbench",
    "load_scene": "world",
    "play": "",
    "plots": "",
    "random_key": "ledger",
    "reproduced": "workbench",
    "run_mission": "simulation.mission",
    "simulated_key": "ledger",
    "survey": "simulation.survey",
    "tampering": "experiments.ledger",
    "team_sightings": "simulation.sightings",
    "verify": "ledger",
    "verify_proof": "ledger",
    "view": "viewer",
    "view_change": "panorama",
    "watch": "workbench",
    "why": "workbench",
}
__all__ = list(_HOMES)
if not TYPE_CHECKING:  # or every name would be known
    __getattr__, __dir__ = lazy(__name__, _HOMES)
