"""The paper's synthetic protocol, rebuilt: objects, fields, clips, rows and report. `benchmarks/paper_tables/tables.py` runs it."""
