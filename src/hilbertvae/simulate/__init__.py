"""Simulated sites: buildings and streets, and the lasers that scan them."""

SCENES = 3
"""Goes up whenever the same settings and seed come to give other scans: what was made of a site's scans is no longer of that site."""
