"""Studies of the tool's design: each makes a vgroove.report.Report of tables, figures and JSON."""
