"""Displays of plclink for several tools, from one description (displays.py)."""
