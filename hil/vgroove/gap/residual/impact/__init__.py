"""Logs of a hammering tool as residuals of cycle statistics: period, levels and shape of current,
speed and bus over the impact cycle, window by window along the joint.
"""
