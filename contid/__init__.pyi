from contid.api.robot import Robot as Robot
from contid.client import Client as Client

__version__: str
__all__ = ["Client", "Robot", "__version__"]
