"""Pythagorean-hodograph quintics as backbone shapes (Singh et al., 2018)."""
