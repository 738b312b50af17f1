"""Fractional integrals and derivatives on any mesh: powers of the mesh's integration matrix."""
