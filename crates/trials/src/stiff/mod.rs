//! Optimizers against stiff problems: error against time and against gradient evaluations.
