"""Calibration: the closed loop tuned to the patient's heart and pressures."""
