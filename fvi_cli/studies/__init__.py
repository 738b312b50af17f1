"""Floor 5: experiments, studies, norms and order fits."""
