//! Tensors from and to lists of vectors, quaternions and matrices.

use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::RenderError;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4, Mat3, Mat4, Quat, Vec2, Vec3, Vec3A, Vec4};

use crate::error::SceneError;

/// What is a row of a tensor: the vectors, quaternions and matrices of glam, or a type of yours.
pub trait Row: Copy {
    /// The type of its numbers.
    type Number: Scalar;

    /// The shape of one: `[3]` of a `Vec3`, `[4, 4]` of a `Mat4`.
    const SHAPE: &'static [usize];

    /// Adds its numbers to `entries`, those of a matrix row by row.
    fn write(self, entries: &mut Vec<Self::Number>);

    /// The one with these numbers, as many as [`Row::SHAPE`] has.
    fn read(entries: &[Self::Number]) -> Self;
}

/// The tensor of these rows: `[n, 3]` of `Vec3`, `[n, 4, 4]` of `Mat4`.
///
/// ```
/// use bokashi_scene::arrays::{rows_of, tensor_of_rows};
/// use bokashi_scene::glam::Vec3;
///
/// let points = [Vec3::X, Vec3::new(1.0, 2.0, 3.0)];
/// let tensor = tensor_of_rows(&points);
/// assert_eq!(**tensor.shape(), [2, 3]);
/// assert_eq!(rows_of::<Vec3>(&tensor)?, points);
/// # Ok::<(), bokashi_scene::SceneError>(())
/// ```
///
/// # Panics
/// Where a type of yours writes more or fewer numbers than its [`Row::SHAPE`] has.
pub fn tensor_of_rows<R: Row>(rows: &[R]) -> Tensor<R::Number> {
    let size = R::SHAPE.iter().product::<usize>();
    let mut entries = Vec::with_capacity(rows.len() * size);
    rows.iter().for_each(|row| row.write(&mut entries));
    let shape: Vec<_> = [rows.len()].iter().chain(R::SHAPE).copied().collect();
    let tensor = Tensor::new(shape.as_slice(), entries);
    tensor.unwrap_or_else(|error| panic!("a row writes as many numbers as its shape has: {error}"))
}

/// The rows of a tensor `[n, 3]`, `[n, 4, 4]` and so on: [`tensor_of_rows`] the other way.
///
/// # Errors
/// [`SceneError::Render`] for another shape.
pub fn rows_of<R: Row>(tensor: &Tensor<R::Number>) -> Result<Vec<R>, SceneError> {
    match tensor.shape().split_first() {
        Some((_, rest)) if rest == R::SHAPE => {
            let size = R::SHAPE.iter().product::<usize>().max(1);
            Ok(tensor.data().chunks_exact(size).map(R::read).collect())
        }
        _ => {
            let extents: Vec<_> = R::SHAPE.iter().map(usize::to_string).collect();
            let rule = format!("shape [n, {}]", extents.join(", "));
            let (operation, shape) = ("rows_of", tensor.shape().clone());
            Err(RenderError::Shape { operation, rule, shape }.into())
        }
    }
}

macro_rules! vectors {
    ($($name:ident: $number:ty, $size:literal;)*) => {$(
        impl Row for $name {
            type Number = $number;
            const SHAPE: &'static [usize] = &[$size];

            fn write(self, entries: &mut Vec<$number>) {
                entries.extend(self.to_array());
            }

            fn read(entries: &[$number]) -> Self {
                Self::from_slice(entries)
            }
        }
    )*};
}

vectors! {
    Vec2: f32, 2;
    Vec3: f32, 3;
    Vec3A: f32, 3;
    Vec4: f32, 4;
    Quat: f32, 4;
    DVec2: f64, 2;
    DVec3: f64, 3;
    DVec4: f64, 4;
    DQuat: f64, 4;
}

/// Matrices of glam lie column by column, tensors row by row.
macro_rules! matrices {
    ($($name:ident: $number:ty, $size:literal;)*) => {$(
        impl Row for $name {
            type Number = $number;
            const SHAPE: &'static [usize] = &[$size, $size];

            fn write(self, entries: &mut Vec<$number>) {
                entries.extend(self.transpose().to_cols_array());
            }

            fn read(entries: &[$number]) -> Self {
                Self::from_cols_slice(entries).transpose()
            }
        }
    )*};
}

matrices! {
    Mat3: f32, 3;
    Mat4: f32, 4;
    DMat3: f64, 3;
    DMat4: f64, 4;
}
