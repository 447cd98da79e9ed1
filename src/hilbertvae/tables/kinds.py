"""The sweeps that have a table of their own, by name alone: a command's --help does not wait for what draws them."""

KINDS = ("table1", "table2", "fig2", "fig6", "fig7", "tradeoff", "ablation", "generalise")
