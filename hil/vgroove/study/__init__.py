"""The design's studies: each makes tables, a JSON object and figures, written by
vgroove.study.report.
"""
