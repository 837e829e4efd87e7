"""The uncertain lumen: the law of the radius along every centreline, and what a draw does to the 0D network."""
