"""From a wrong prediction to the missing physical effect: compare, screen, refit, judge."""
