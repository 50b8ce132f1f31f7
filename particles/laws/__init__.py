"""Contact laws, one file a law: constants for the user, the kernel of a contact for the loops."""

from particles.laws.bonded import Bonded
from particles.laws.li_chu import LiChu
from particles.laws.linear import linear_sliding

__all__ = ["Bonded", "LiChu", "linear_sliding"]
