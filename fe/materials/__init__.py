"""Material laws as bare derivatives, and the chain rules they share."""

from fe.materials.law import LAWS, Law
from fe.materials.material import KernelMaterial, Material, bulk_modulus, material

__all__ = ["LAWS", "KernelMaterial", "Law", "Material", "bulk_modulus", "material"]
