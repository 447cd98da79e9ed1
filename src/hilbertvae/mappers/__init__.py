"""Estimators that are fitted on a cloud and answer p(occupied) at any points."""
