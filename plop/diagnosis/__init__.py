"""From recordings to a verdict: evidence, responses of laws, scores, decision; each uses those before it."""
