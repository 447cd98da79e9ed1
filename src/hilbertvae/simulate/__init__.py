"""Simulated sites: buildings in the plane, streets and floors of buildings in space, and the lasers that scan them."""

SCENES = {2: 4, 3: 5}
"""Of buildings (2D), and of streets and floors (3D): goes up whenever the same settings and seed come to give other scans. What
was made of a site's scans is no longer of that site."""
