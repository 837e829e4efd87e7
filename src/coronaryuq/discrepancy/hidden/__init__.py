"""Cases with an effect hidden on purpose."""
