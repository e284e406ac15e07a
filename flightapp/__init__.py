"""Onboard flight application for autonomous drone racing."""
