"""Estimators of machines from recordings, apart from the equations that simulate them."""
