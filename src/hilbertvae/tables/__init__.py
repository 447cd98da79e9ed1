"""Tables and figures over many runs, made from `result.json` files alone."""
