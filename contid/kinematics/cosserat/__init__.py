"""Statics of hyper-elastic pneumatic rods (Shi et al., "Position and Orientation Control for Hyper-elastic
Multi-segment Continuum Robots"): sections joined by rigid links, bent by three chamber pairs each.

Below `model`, which converts, this package computes in mm, N, N·mm and bar: the unknowns of a solve (base
moment, pressures) and its residuals are then of the order of one. Vectors are in the base frame unless the
name states another. Moduli are polynomials with pressure in bar and modulus in Pa, as in the paper.
"""  # noqa: D205 - the title of the paper does not fit on one line
