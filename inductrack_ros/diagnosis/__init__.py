"""Which physical effect is missing: adequacy, ranking, decision, ignorance admitted."""
