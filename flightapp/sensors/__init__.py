"""Pose sources and cameras."""
