from contid.api.robot import Robot as Robot
from contid.client import Client as Client
from contid.session.read import Session as Session
from contid_library.rod import ElasticRod as ElasticRod
from contid_library.rod import Wrench as Wrench
from contid_library.simulated import Sim as Sim

__version__: str
__all__ = ["Client", "ElasticRod", "Robot", "Session", "Sim", "Wrench", "__version__"]
