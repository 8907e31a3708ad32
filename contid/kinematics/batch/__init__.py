"""Forward and inverse kinematics of many rows at once, for programs that are not the control process.

Every row is what the single call of `Model` returns for it, bit for bit; the number of threads
changes nothing.
"""

from contid.kinematics.batch.many import forward_many, inverse_many
from contid.kinematics.batch.rows import POSE, Solutions, Table, Targets

__all__ = ["POSE", "Solutions", "Table", "Targets", "forward_many", "inverse_many"]
