"""Contact laws, one file a law: constants for the user, the kernel of a contact for the loops."""

from particles.laws.bonded import Bonded
from particles.laws.hertz import HertzMindlin
from particles.laws.li_chu import LiChu
from particles.laws.linear import linear_sliding
from particles.laws.touch import Response
from particles.laws.user import UserLaw, kernel

__all__ = ["Bonded", "HertzMindlin", "LiChu", "Response", "UserLaw", "kernel", "linear_sliding"]
