"""Nominal tools, joints and bolt that studies and benches run, and the measures of blows they
share.
"""
