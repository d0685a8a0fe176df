//! A preconditioner: a change of variables after which steps of a fit are smooth.
//!
//! # Forward
//! Vertices v are learnt as `u = A v`, `A = I + lambda L`, with the combinatorial Laplacian L of a mesh; v is solved
//! from u. The matrix A is symmetric and positive definite. It is factored once (`factor`), and substitution gives v.
//!
//! # Backward
//! `u_bar = A^-1 v_bar`: the same solve.
//!
//! # Bounds
//! A is an M-matrix, and its rows sum to 1. So each entry of v is a mean of entries of u, with weights
//! from 0 up: finite u have finite v.
//!
//! # Source
//! Nicolet, Jacobson and Jakob, *Large steps in inverse rendering of geometry*, ACM Transactions on
//! Graphics 40(6), 2021, equation 12.

mod factor;

use std::fmt;
use std::sync::Arc;

use bokashi_core::{
    Accumulators, Inputs, Kept, Op, Outputs, Scalar, Shape, Tensor, TensorError, Var,
};

use self::factor::Factor;
use crate::topology::Topology;

/// The change of variables `u = (I + lambda L) v` of numbers at the vertices of a mesh, with the factor that solves for
/// v. Made once, with the feature `precondition`; cheap to clone.
///
/// [`Parameter::preconditioned`](crate::Parameter::preconditioned) learns a parameter as u.
#[derive(Clone)]
pub struct Preconditioner(Arc<Inner>);

struct Inner {
    topology: Topology,
    lambda: f64,
    factor: Factor,
}

const NAME: &str = "precondition";

impl fmt::Debug for Preconditioner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { topology, lambda, factor } = &*self.0;
        f.debug_struct("Preconditioner")
            .field("vertices", &topology.vertex_count())
            .field("lambda", lambda)
            .field("entries", &factor.entry_count())
            .finish_non_exhaustive()
    }
}

/// Two preconditioners are equal if they have the same edges and the same lambda.
impl PartialEq for Preconditioner {
    fn eq(&self, other: &Self) -> bool {
        let [a, b] = [&*self.0, &*other.0];
        let size = |inner: &Inner| (inner.topology.vertex_count(), inner.lambda);
        Arc::ptr_eq(&self.0, &other.0)
            || size(a) == size(b) && a.topology.edges() == b.topology.edges()
    }
}

#[cfg(feature = "precondition")]
impl Preconditioner {
    /// Makes the preconditioner for the vertices of `topology`. With a larger `lambda`, a step at one vertex moves
    /// neighbours farther away; the paper takes 19 for most of its meshes.
    ///
    /// It factors a matrix of the size of the mesh, which takes some microseconds per vertex.
    ///
    /// # Errors
    /// [`TensorError::Value`] for a lambda outside 0 to 1e12, beyond which nothing of I is left in `f64`; also where
    /// there is no memory for the factor.
    pub fn new(topology: &Topology, lambda: f64) -> Result<Self, TensorError> {
        if !(0.0..=1e12).contains(&lambda) {
            let rule = "a lambda from 0 to 1e12".into();
            return Err(TensorError::Value { operation: NAME, rule, value: lambda });
        }
        let factor = Factor::new(topology, lambda).ok_or_else(|| {
            let rule = "memory for its factor".into();
            let value = topology.vertex_count() as f64;
            TensorError::Value { operation: NAME, rule, value }
        })?;
        Ok(Self(Arc::new(Inner { topology: topology.clone(), lambda, factor })))
    }
}

impl Preconditioner {
    /// The mesh.
    pub fn topology(&self) -> &Topology {
        &self.0.topology
    }

    /// Lambda.
    pub fn lambda(&self) -> f64 {
        self.0.lambda
    }

    /// Entries of a row of numbers at the vertices, `[V]` or `[V, C]`.
    fn inner(&self, shape: &Shape) -> Result<usize, TensorError> {
        let count = self.0.topology.vertex_count();
        match **shape {
            [rows] if rows == count => Ok(1),
            [rows, inner] if rows == count => Ok(inner),
            _ => {
                let rule = format!("shape [{count}] or [{count}, C]").into();
                Err(TensorError::Shape { operation: NAME, rule, shape: shape.clone() })
            }
        }
    }

    /// Checks that numbers of this shape stand at the vertices.
    pub(crate) fn check(&self, shape: &Shape) -> Result<(), TensorError> {
        self.inner(shape).map(drop)
    }

    /// `u = (I + lambda L) v` of numbers at the vertices, `[V]` or `[V, C]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    pub fn raw<T: Scalar>(&self, v: &Tensor<T>) -> Result<Tensor<T>, TensorError> {
        let inner = self.inner(v.shape())?;
        let lambda = T::Wide::from_f64(self.0.lambda);
        // u_i = v_i + lambda sum_j (v_i - v_j) over the neighbours j of i
        let entry = |k: usize| {
            let (vertex, column) = (k / inner, k % inner);
            let value = v.data()[k].widen();
            let around = self.0.topology.neighbors(vertex).iter();
            let apart =
                around.map(|&other| value - v.data()[other as usize * inner + column].widen());
            T::narrow(value + lambda * apart.sum())
        };
        Ok(Tensor::from_flat_fn(v.shape(), entry))
    }

    /// `v = (I + lambda L)^-1 u` of numbers at the vertices, `[V]` or `[V, C]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    pub fn value<T: Scalar>(&self, u: &Tensor<T>) -> Result<Tensor<T>, TensorError> {
        let inner = self.inner(u.shape())?;
        let mut v = u.clone();
        let entries = v.data_mut();
        self.0.factor.solve_rows(u.data(), inner, &mut Vec::new(), |k, x| entries[k] = x);
        Ok(v)
    }

    /// [`Preconditioner::value`] of a variable.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    #[inline(never)]
    pub fn record<'t, T: Scalar>(&self, u: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
        u.tape().apply(self.clone(), &[u])
    }
}

impl<T: Scalar> Op<T> for Preconditioner {
    /// Memory.
    type Saved = Vec<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        memory: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let shape = inputs.shape(0);
        let inner = self.inner(shape)?;
        if self.0.lambda == 0.0 {
            outputs.pass(0, "lambda = 0: the identity");
            return Ok(());
        }
        let v = outputs.push(shape);
        self.0.factor.solve_rows(inputs.data(0), inner, memory, |k, x| v[k] = x);
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        memory: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(u_bar) = gradients.get(0) else { return };
        let inner = kept.input_shape(0)[1..].iter().product();
        let (u_bar, fresh) = u_bar.entries_or_fresh();
        self.0.factor.solve_rows(kept.only_upstream(), inner, memory, |k, term: T| {
            u_bar[k] = if fresh { term } else { u_bar[k] + term };
        });
    }
}

#[cfg(all(test, feature = "precondition"))]
mod tests {
    use bokashi_core::{Dual, Tape};

    use super::*;

    /// A sheet of `side` by `side` quads, with a vertex more that has no face.
    fn sheet(side: u32) -> Topology {
        let mut faces = Vec::new();
        for k in 0..side * side {
            let first = k / side * (side + 1) + k % side;
            let above = first + side + 1;
            faces.extend([[first, first + 1, above + 1], [first, above + 1, above]]);
        }
        Topology::new(&faces, ((side + 1) * (side + 1) + 1) as usize).unwrap()
    }

    fn motley(shape: &[usize]) -> Tensor<f64> {
        Tensor::from_flat_fn(shape, |k| ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.4)
    }

    #[test]
    fn the_value_of_the_raw_numbers_is_the_value_at_every_width() {
        for side in [1, 2, 7, 40] {
            let topology = sheet(side);
            let count = topology.vertex_count();
            for lambda in [0.0, 1e-3, 1.0, 19.0, 1e6] {
                let preconditioner = Preconditioner::new(&topology, lambda).unwrap();
                for shape in [&[count][..], &[count, 1], &[count, 3], &[count, 5], &[count, 0]] {
                    let v = motley(shape);
                    let u = preconditioner.raw(&v).unwrap();
                    let laplacian = topology.combinatorial_laplacian::<f64>();
                    let tape = Tape::new();
                    let product = laplacian.product(tape.constant(&v)).unwrap().value();
                    let found = preconditioner.value(&u).unwrap();
                    for k in 0..v.size() {
                        let expected = v.data()[k] + lambda * product.data()[k];
                        let off = (u.data()[k] - expected).abs();
                        assert!(off <= 1e-14 * (1.0 + lambda), "{side} {lambda} {off}");
                        let error = (found.data()[k] - v.data()[k]).abs();
                        assert!(error <= 1e-14 * (1.0 + lambda), "{side} {lambda} {error}");
                    }
                    // What is recorded is the same, and again within a used tape.
                    let recorded = preconditioner.record(tape.leaf(&u)).unwrap().value();
                    assert_eq!(recorded.data().len(), found.data().len());
                    if lambda > 0.0 {
                        assert_eq!(recorded, found);
                    }
                }
            }
        }
    }

    #[test]
    fn the_backward_pass_is_the_adjoint_and_adds_up() {
        let topology = sheet(9);
        let preconditioner = Preconditioner::new(&topology, 19.0).unwrap();
        let shape = [topology.vertex_count(), 3];
        let (u, upstream) = (motley(&shape), motley(&shape).map(|x| x * x));
        let tape = Tape::new();
        let leaf = tape.leaf(&u);
        let v = preconditioner.record(leaf).unwrap();
        let gradient = tape.vjp(&[(v, &upstream)]).unwrap().get_or_zeros(leaf);
        assert_eq!(gradient, preconditioner.value(&upstream).unwrap());
        let inner = |a: &Tensor<f64>, b: &Tensor<f64>| -> f64 {
            a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
        };
        let (left, right) = (inner(&v.value(), &upstream), inner(&u, &gradient));
        approx::assert_relative_eq!(left, right, max_relative = 1e-13);
        // Used twice, and beside another way.
        let both = (v + preconditioner.record(leaf).unwrap()) + leaf;
        let sum = tape.vjp(&[(both, &upstream)]).unwrap().get_or_zeros(leaf);
        for k in 0..u.size() {
            let expected = 2.0 * gradient.data()[k] + upstream.data()[k];
            approx::assert_relative_eq!(sum.data()[k], expected, max_relative = 1e-14);
        }
    }

    #[test]
    fn duals_go_through_part_by_part_and_f32_is_the_rounded_f64() {
        let topology = sheet(6);
        let preconditioner = Preconditioner::new(&topology, 19.0).unwrap();
        let shape = [topology.vertex_count(), 3];
        let (u, along) = (motley(&shape), motley(&shape).map(f64::sin));
        let dual = Tensor::from_flat_fn(shape, |k| Dual::new(u.data()[k], along.data()[k]));
        let found = preconditioner.value(&dual).unwrap();
        let parts = [&u, &along].map(|part| preconditioner.value(part).unwrap());
        for (k, found) in found.data().iter().enumerate() {
            assert_eq!(found.value, parts[0].data()[k]);
            approx::assert_relative_eq!(found.tangent, parts[1].data()[k], max_relative = 1e-13);
        }
        let single = u.cast::<f32>();
        let wide = preconditioner.value(&single.cast::<f64>()).unwrap().cast::<f32>();
        assert_eq!(preconditioner.value(&single).unwrap(), wide);
    }

    #[test]
    fn constants_and_the_mean_are_kept_and_nothing_leaves_the_range_of_u() {
        let topology = sheet(12);
        let count = topology.vertex_count();
        for lambda in [1.0, 1e4, 1e12] {
            let preconditioner = Preconditioner::new(&topology, lambda).unwrap();
            let flat = preconditioner.value(&Tensor::full([count], 3.0)).unwrap();
            // The condition of the matrix: what f64 keeps of a constant.
            let bound = 1e-15 * (1.0 + lambda) * 10.0;
            assert!(flat.data().iter().all(|v| (v - 3.0).abs() <= bound.min(1.0)), "{lambda}");
            let mut spike = Tensor::zeros([count]);
            spike.data_mut()[40] = 1.0;
            let spread = preconditioner.value(&spike).unwrap();
            assert!(spread.data().iter().all(|v| (-1e-12..=1.0).contains(v)));
            let sum: f64 = spread.data().iter().sum();
            assert!((sum - 1.0).abs() <= bound.min(0.5), "{lambda} {sum}");
            assert_eq!(spread.data()[count - 1], 0.0);
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let topology = sheet(1);
        for lambda in [-1.0, f64::NAN, f64::INFINITY, 1e13] {
            let error = Preconditioner::new(&topology, lambda).unwrap_err().to_string();
            assert_eq!(error, format!("precondition needs a lambda from 0 to 1e12, got {lambda}"));
        }
        let preconditioner = Preconditioner::new(&topology, 1.0).unwrap();
        let tape = Tape::<f64>::new();
        for shape in [&[4][..], &[5, 2, 1], &[]] {
            let message = format!("precondition needs shape [5] or [5, C], got shape {shape:?}");
            let error = preconditioner.record(tape.leaf(&Tensor::zeros(shape))).unwrap_err();
            assert_eq!(error.to_string(), message);
        }
        let empty = Preconditioner::new(&Topology::new(&[], 0).unwrap(), 1.0).unwrap();
        assert_eq!(empty.value(&Tensor::<f64>::zeros([0, 3])).unwrap().size(), 0);
        // Only of the same edges and lambda are two alike.
        assert_eq!(preconditioner, Preconditioner::new(&sheet(1), 1.0).unwrap());
        assert_ne!(preconditioner, Preconditioner::new(&sheet(1), 2.0).unwrap());
        assert_ne!(preconditioner, Preconditioner::new(&sheet(2), 1.0).unwrap());
    }
}
