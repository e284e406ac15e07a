"""The whole tunable surface: every field with its unit, its bounds and a one-line description.

A configuration is built from defaults ← vehicle file ← mission ← ``--set``, and is checked whole; what is
wrong is named by source, key, value, bound and nearest known key.
"""

from flightapp.config.fields import Section
from flightapp.config.flight import Control, Guard, Mission, Mpc, Mpcc, Planning, Race, Term
from flightapp.config.perception import Detection, Estimation, GateMapping, Sensors
from flightapp.config.safety import Geofence, Safety
from flightapp.config.system import Compute, ExternalVision, Link, Realtime, Recording, Simulation
from flightapp.config.vehicle import Camera, Vehicle
from flightapp.config.whole import Config, dump_config, load_config, with_settings

__all__ = [
    "Camera",
    "Compute",
    "Config",
    "Control",
    "Detection",
    "Estimation",
    "ExternalVision",
    "GateMapping",
    "Geofence",
    "Guard",
    "Link",
    "Mission",
    "Mpc",
    "Mpcc",
    "Planning",
    "Race",
    "Realtime",
    "Recording",
    "Safety",
    "Section",
    "Sensors",
    "Simulation",
    "Term",
    "Vehicle",
    "dump_config",
    "load_config",
    "with_settings",
]
