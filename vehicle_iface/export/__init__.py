"""Writes a recording in formats of other programs: CSV for spreadsheets, MCAP for Foxglove and PlotJuggler."""
