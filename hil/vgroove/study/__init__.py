"""The design's studies: each makes a vgroove.report.Report of tables, figures and JSON."""
