from contid.api.robot import Robot as Robot
from contid.api.rod import ElasticRod as ElasticRod
from contid.api.rod import Wrench as Wrench
from contid.api.simulated import Sim as Sim
from contid.client import Client as Client
from contid.session.read import Session as Session

__version__: str
__all__ = ["Client", "ElasticRod", "Robot", "Session", "Sim", "Wrench", "__version__"]
