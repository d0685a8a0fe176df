//! A law that does not hold, and where.

use std::fmt;

use bokashi_core::{Shape, Tensor};

/// A law that every operation keeps. `Display` gives a short name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Law {
    /// The subject takes its inputs, gives finite numbers, and does not panic in either pass; it
    /// reads nothing in its backward pass that it did not ask to keep.
    Defined,
    /// The gradient agrees with a Richardson pair of difference quotients, within its error bar.
    Differences,
    /// `<J v, u> = <v, J^T u>`, with `J v` over dual numbers.
    Adjoint,
    /// Hessian-vector products are symmetric and agree with differences of gradients.
    Curvature,
    /// Whichever inputs need a gradient, they get the same bits, and the others get none.
    Masks,
    /// A gradient is added to what is there; one variable as two inputs gets both gradients; an
    /// unused output adds nothing.
    Accumulation,
    /// The backward pass is linear in the upstream gradient, exactly so for powers of two.
    Linearity,
    /// A step in recycled memory gives the same bits.
    Recycling,
    /// Any number of threads gives the same bits.
    Threads,
    /// `f32` agrees with `f64` within the rounding of its inputs and outputs.
    Precision,
    /// Wrong input is an error that leaves the tape as it was.
    Refusals,
}

impl Law {
    /// Every law, in the order of checking.
    pub const ALL: [Self; 11] = [
        Self::Defined,
        Self::Differences,
        Self::Adjoint,
        Self::Curvature,
        Self::Masks,
        Self::Accumulation,
        Self::Linearity,
        Self::Recycling,
        Self::Threads,
        Self::Precision,
        Self::Refusals,
    ];
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Defined => "defined",
            Self::Differences => "differences",
            Self::Adjoint => "adjoint",
            Self::Curvature => "curvature",
            Self::Masks => "masks",
            Self::Accumulation => "accumulation",
            Self::Linearity => "linearity",
            Self::Recycling => "recycling",
            Self::Threads => "threads",
            Self::Precision => "precision",
            Self::Refusals => "refusals",
        })
    }
}

/// How a law was broken.
#[derive(Debug, Clone, PartialEq)]
pub struct Broken {
    /// What the numbers are: `d out[3,1] / d in0[2]`, or what happened.
    pub what: String,
    /// The numbers, where there are any.
    pub numbers: Option<Numbers>,
}

/// A number that is not what it should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbers {
    /// What the subject gave.
    pub got: f64,
    /// What it should have given.
    pub expected: f64,
    /// By how much they may differ.
    pub bound: f64,
}

impl Broken {
    pub(crate) fn from_message(what: impl Into<String>) -> Self {
        Self { what: what.into(), numbers: None }
    }

    pub(crate) fn numbers(what: impl Into<String>, got: f64, expected: f64, bound: f64) -> Self {
        Self { what: what.into(), numbers: Some(Numbers { got, expected, bound }) }
    }
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(Numbers { got, expected, bound }) = self.numbers else {
            return f.write_str(&self.what);
        };
        // As many digits as tell the two apart, and two more.
        let apart = (got - expected).abs() / got.abs().max(expected.abs());
        let digits = if apart > 0.0 { (2.0 - apart.log10()).clamp(2.0, 17.0) } else { 17.0 };
        let (got, expected) = (rounded(got, digits as usize), rounded(expected, digits as usize));
        write!(f, "{}: got {got}, expected {expected} +- {bound:.0e}", self.what)
    }
}

/// `x` to so many significant digits, without an exponent where it is of ordinary size.
fn rounded(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let scientific = format!("{x:.*e}", digits - 1);
    let nearest: f64 = scientific.parse().unwrap_or(x);
    if (1e-4..1e6).contains(&nearest.abs()) { nearest.to_string() } else { format!("{nearest:e}") }
}

/// A law that a subject breaks, with the smallest inputs found that break it.
#[derive(Debug, Clone)]
pub struct Failure {
    /// The subject's name.
    pub name: String,
    /// The law.
    pub law: Law,
    /// Where, and by how much.
    pub broken: Broken,
    /// The subject, its inputs and the upstream gradients, as text.
    pub inputs: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, law, broken, inputs } = self;
        write!(f, "{name} breaks the law of {law}: {broken}\n{inputs}")
    }
}

impl std::error::Error for Failure {}

/// `out[3,1]`: entry `k` of a tensor of `shape`, in its own coordinates.
pub(crate) fn entry(tensor: &str, shape: &Shape, mut k: usize) -> String {
    let mut indices = Vec::new();
    for &extent in shape.iter().rev() {
        indices.push((k % extent).to_string());
        k /= extent;
    }
    indices.reverse();
    if indices.is_empty() { tensor.to_owned() } else { format!("{tensor}[{}]", indices.join(",")) }
}

/// The name of what a gradient differentiates: the only output entry with an upstream gradient,
/// or the whole of `<u, out>`.
pub(crate) fn differentiated(upstream: &[Tensor<f64>]) -> String {
    let mut entries = upstream.iter().enumerate().flat_map(|(j, u)| {
        let not_zero = u.data().iter().enumerate().filter(|&(_, &u)| u != 0.0);
        not_zero.map(move |(k, &weight)| (j, k, weight))
    });
    match (entries.next(), entries.next()) {
        (Some((j, k, 1.0)), None) => {
            let name = if upstream.len() == 1 { "out".to_owned() } else { format!("out{j}") };
            entry(&name, upstream[j].shape(), k)
        }
        _ => "<u, out>".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_reads_like_a_sentence() {
        let mut upstream = Tensor::zeros([4, 2]);
        upstream.data_mut()[7] = 1.0;
        let what = differentiated(&[upstream]);
        let place = entry("in0", &[5].into(), 2);
        let broken = Broken::numbers(format!("d {what} / d {place}"), 0.31, 0.28, 1e-7);
        let message = "d out[3,1] / d in0[2]: got 0.31, expected 0.28 +- 1e-7";
        assert_eq!(broken.to_string(), message);
    }

    #[test]
    fn digits_tell_two_numbers_apart() {
        let message = |got, expected| Broken::numbers("x", got, expected, 1e-9).to_string();
        assert_eq!(message(1.000_002, 1.0), "x: got 1.000002, expected 1 +- 1e-9");
        assert_eq!(message(3e-20, 0.0), "x: got 3e-20, expected 0 +- 1e-9");
        assert_eq!(message(f64::NAN, 2.0), "x: got NaN, expected 2 +- 1e-9");
    }

    #[test]
    fn several_upstream_entries_have_no_name_of_their_own() {
        assert_eq!(differentiated(&[Tensor::full([2], 1.0)]), "<u, out>");
        assert_eq!(differentiated(&[Tensor::scalar(1.0)]), "out");
        assert_eq!(differentiated(&[Tensor::zeros([3]), Tensor::full([1], 1.0)]), "out1[0]");
        assert_eq!(entry("in1", &[].into(), 0), "in1");
    }
}
