"""The paper's synthetic protocol, rebuilt: objects, fields, clips, rows and report. `benchmarks/tables.py` runs it."""
