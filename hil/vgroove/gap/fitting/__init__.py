"""Fits of effect parameters: damped Gauss-Newton in lock step, normal equations, cross-validation,
confidence intervals.
"""
