"""Metrics, tables, figures and sweeps, from flight logs."""
