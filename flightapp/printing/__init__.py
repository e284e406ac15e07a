"""Markers, boards and drawings on paper, at their exact size."""
