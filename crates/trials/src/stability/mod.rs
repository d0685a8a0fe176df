//! The extreme-case grid: input, expected result or error, what came out.
