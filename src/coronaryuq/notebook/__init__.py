"""What a notebook or a script may use; `coronaryuq` itself gives these names, and they stay."""
