"""Shear-flexible beams on a straight reference line: elements, meshes, sparse matrices."""
