"""Methods of hidden-surface removal measured against the oracle: rows, report, the paper's tables and figures."""
