"""Statics of hyper-elastic pneumatic rods (Shi et al., "Position and Orientation Control for Hyper-elastic
Multi-segment Continuum Robots"): sections joined by rigid links, bent by three chamber pairs each.

Everything in this package below `model` computes in mm, N, N·mm and bar, because in these units the unknowns
of a solve (base moment, pressures) and its residuals are all of the order of one; `model` converts at its
edge. Moduli are polynomials with pressure in bar and modulus in Pa, as the paper prints them.
"""  # noqa: D205 - the title of the paper does not fit on one line
