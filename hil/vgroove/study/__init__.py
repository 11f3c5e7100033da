"""Studies of the tool's design: each makes a report of tables, figures and JSON (result_files)."""
