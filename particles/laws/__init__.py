"""Contact laws, one file a law: constants for the user, pair kernels for the loops."""

from particles.laws.li_chu import LiChu

__all__ = ["LiChu"]
