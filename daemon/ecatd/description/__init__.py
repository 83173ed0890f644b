"""The bus description: slaves, PDOs, modules, what values mean, and who says so."""
