"""Results of a run: expectations and verdicts, summary, figure and files."""
