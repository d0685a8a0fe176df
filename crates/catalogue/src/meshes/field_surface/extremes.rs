//! Fields of every size, of zeros, and of points between which nothing fits.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_mesh::{Grid, extract_surface, field_surface};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, has_finite_gradients, numbers, rounding, tensor};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    211 "a field: numbers of every size", "the same surface, finite", sizes;
    212 "a field: zeros at points", "closed, no flat face", zeros;
    213 "a field: no change of sign", "an empty surface, no gradient", nothing;
    214 "a field: 1e-30 beside 1e30", "vertices at the ends", far_apart;
};

/// A sphere about the middle of a grid whose points have whole coordinates.
fn whole() -> Grid {
    Grid::new([9; 3], [-4.0; 3], 1.0).expect("a grid")
}

fn sphere([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt() - 2.6
}

fn sizes<T: Scalar>() -> Outcome {
    let grid = whole();
    let (expected, faces) = extract_surface(&grid.sampled::<T>(sphere), None, &grid)?;
    let mut error = 0.0_f64;
    // Powers of two: the quotients have the same bits.
    for power in [-60, -20, 20, 60] {
        let field: Tensor<T> =
            grid.sampled(|p| T::from_f64(sphere(p)).to_f64() * f64::powi(2.0, power));
        let tape = Tape::new();
        let leaf = tape.leaf(&field);
        let surface = field_surface(leaf, None, &grid)?;
        error = error.max(difference(&numbers(&surface.positions.value()), &numbers(&expected)));
        let is_same = surface.mesh.faces() == faces.faces();
        if !is_same || !has_finite_gradients(surface.positions, &[leaf])? {
            return Ok(Verdict::failed(format!("2^{power}: other faces, or gradients")));
        }
    }
    Ok(Verdict::within("the same vertices", error, 0.0))
}

fn zeros<T: Scalar>() -> Outcome {
    let grid = whole();
    let fields: [fn([f64; 3]) -> f64; 3] = [
        |p| sphere(p).min(0.0),
        |[x, y, z]| x.abs() + y.abs() + z.abs() - 3.0,
        |p| sphere(p).round(),
    ];
    let mut wrong = 0;
    for field in fields {
        let tape = Tape::<T>::new();
        let leaf = tape.leaf(&grid.sampled(field));
        let surface = field_surface(leaf, None, &grid)?;
        let at = numbers(&surface.positions.value());
        let at = |vertex: u32| &at[3 * vertex as usize..][..3];
        let is_flat = |face: &&[u32; 3]| {
            let [a, b, c] = **face;
            at(a) == at(b) || at(b) == at(c) || at(c) == at(a)
        };
        wrong += surface.mesh.faces().iter().filter(is_flat).count();
        let adjacency = surface.mesh.adjacency();
        wrong += adjacency.boundary_edges() + adjacency.crowded_edges();
        wrong += usize::from(surface.mesh.faces().is_empty());
        wrong += usize::from(!has_finite_gradients(surface.positions, &[leaf])?);
    }
    Ok(Verdict::exactly("closed, every face with three corners", wrong))
}

fn nothing<T: Scalar>() -> Outcome {
    let grid = whole();
    let mut wrong = 0;
    for value in [0.0, -0.0, 1e-30, -1e-30, 1e30, -1e30] {
        let tape = Tape::<T>::new();
        let leaf = tape.leaf(&tensor(&grid.shape(), |_| value));
        let surface = field_surface(leaf, None, &grid)?;
        wrong += surface.mesh.faces().len() + surface.mesh.vertex_count();
        let gradients = surface.positions.sum().backward()?;
        let bars = numbers(&gradients.get_or_zeros(leaf));
        wrong += bars.iter().filter(|&&bar| bar != 0.0).count();
    }
    Ok(Verdict::exactly("no vertex", wrong))
}

fn far_apart<T: Scalar>() -> Outcome {
    let grid = Grid::new([2, 2, 2], [1.0, 2.0, 3.0], 0.5)?;
    let mut error = 0.0_f64;
    for [inside, outside] in [[-1e-30, 1e30], [-1e30, 1e-30], [-1e30, 1e30], [-1e-30, 1e-30]] {
        // Half of the points, along x.
        let field = |k: usize| if k < 4 { inside } else { outside };
        let tape = Tape::<T>::new();
        let leaf = tape.leaf(&tensor(&[8], field));
        let surface = field_surface(leaf, None, &grid)?;
        let share = inside / (inside - outside);
        for vertex in numbers(&surface.positions.value()).as_chunks::<3>().0 {
            error = error.max((vertex[0] - 1.0 - 0.5 * share).abs());
        }
        // Those of the smallest numbers are as large as they are small.
        if inside == -1e30 && outside == 1e30 && !has_finite_gradients(surface.positions, &[leaf])?
        {
            return Ok(Verdict::failed("a gradient is not finite"));
        }
    }
    Ok(Verdict::within("at the ends, or halfway", error, 4.0 * rounding::<T>()))
}
