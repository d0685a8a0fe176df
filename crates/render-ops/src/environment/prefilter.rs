//! What a surface sees of a cube map: blurred mirror images, and its harmonics.
//!
//! # Forward
//! A mirror image of a rough surface in direction r is the mean of the radiance from all directions l, with the
//! weights `D(h) (r . l)` of a surface that is seen along its normal, `n = v = r`. With
//! `q = (1 - r . l) / 2`, the squared sine between n and h, GGX has `D ~ 1 / (q + a^2 (1 - q))^2`.
//!
//! The sphere is cut into blocks of texels, `2^j` along a side. A block's weight is the mean of those at the
//! middles of its quarters, times its solid angle; the weights of a mean are divided by their sum. Blocks are
//! as large as the lobe allows: [`SHARE`]` / (1 + 2 a)` of `2 sqrt(q + a^2)`, the angle over which it changes. So
//! the number of blocks of a mean is bounded, whatever the size of the map. In a block the radiance is taken for
//! the same everywhere. So blocks of wide lobes are smaller shares of them: a sky changes as slowly as they do.
//!
//! Coefficients of harmonics are `L_i = int L Y_i`, with the functions' means over a texel of 4 x 4 places.
//!
//! # Backward
//! All of it is linear in the texels, with constant weights: sums of texels to blocks, a sparse product,
//! a dense one.
//!
//! # Source
//! Karis, *Real shading in Unreal Engine 4*, SIGGRAPH 2013 course (`n = v = r`); Walter et al., EGSR 2007
//! (D). The blocks are our own.

use bokashi_core::parallel::for_each_item_mut;
use bokashi_core::{Scalar, SparseMatrix, Tensor, TensorError, Var};

use super::harmonics::{HARMONICS, harmonics};
use crate::cube_faces::{direction, ratio, solid_angle};
use crate::error::RenderError;
use crate::mipmaps::halved;
use crate::texture::CubeMap;
use crate::vector::{Direction, Vector3, dot};

const NAME: &str = "prefilter";

/// A block's side as a share of the angle over which a narrow lobe changes. At 0.3 a mean is off by 0.4 % of a
/// map's contrast at most, and has 540 blocks or fewer; of four levels, 470 or fewer. `1 + x + z^2` is off by
/// 0.08, 0.20 and 0.15 % at the roughnesses 1/3, 2/3 and 1, in a map of 64 texels.
const SHARE: f64 = 0.3;

/// The largest faces: of more texels the weights would take gigabytes.
const MOST_TEXELS: usize = 256;

/// Places per side of a texel where harmonics are taken.
const PLACES: usize = 4;

/// The weights by which surfaces see a cube map. They depend on its size alone: make them once.
#[derive(Debug, Clone)]
pub struct Prefilter<T: Scalar> {
    /// Texels along a side of a face.
    extent: usize,
    /// Of each level but the first, from blocks of all sizes.
    levels: Vec<SparseMatrix<T>>,
    /// `[6, S, S, 1]`.
    solid_angles: Tensor<T>,
    /// `[9, 6 S S]`, times solid angles.
    harmonics: Tensor<T>,
}

/// A square of texels of a face, by its number among those of its size.
#[derive(Debug, Clone, Copy)]
struct Block {
    face: usize,
    row: usize,
    column: usize,
    /// Blocks of this size along a side of a face.
    extent: usize,
}

impl Block {
    /// Its number among all blocks of its size.
    fn index(self) -> usize {
        (self.face * self.extent + self.row) * self.extent + self.column
    }

    fn from_index(index: usize, extent: usize) -> Self {
        let (rest, column) = (index / extent, index % extent);
        Self { face: rest / extent, row: rest % extent, column, extent }
    }

    /// The four blocks of half the side.
    fn quarters(self) -> [Self; 4] {
        let Self { face, row, column, extent } = self;
        [0, 1, 2, 3].map(|k| Self {
            face,
            row: 2 * row + k / 2,
            column: 2 * column + k % 2,
            extent: 2 * extent,
        })
    }

    fn solid_angle(self) -> f64 {
        let side = |k: usize| [k, k + 1].map(|k| ratio(k as f64, self.extent));
        solid_angle(side(self.column), side(self.row))
    }

    /// The unit vector to a place, in shares of the block's sides.
    fn unit(self, [x, y]: [f64; 2]) -> Vector3<f64> {
        let point = [self.column as f64 + x, self.row as f64 + y];
        let towards = direction(self.face, point.map(|coordinate| ratio(coordinate, self.extent)));
        Direction::new(towards).map_or(towards, |direction| direction.unit)
    }

    fn middle(self) -> Vector3<f64> {
        self.unit([0.5; 2])
    }
}

/// The lobe of a rough surface, around a direction.
#[derive(Debug, Clone, Copy)]
struct Lobe {
    towards: Vector3<f64>,
    /// The square of GGX's alpha.
    a2: f64,
    /// The largest side of a block, as a share of the angle over which the lobe changes.
    share: f64,
}

impl Lobe {
    fn new(towards: Vector3<f64>, roughness: f64) -> Self {
        let alpha = roughness * roughness;
        Self { towards, a2: alpha * alpha, share: SHARE / (1.0 + 2.0 * alpha) }
    }

    /// q of a direction.
    fn squared_sine(&self, l: Vector3<f64>) -> f64 {
        0.5 * (1.0 - dot(self.towards, l)).max(0.0)
    }

    fn weight(&self, l: Vector3<f64>) -> f64 {
        let q = self.squared_sine(l);
        let d = q + self.a2 * (1.0 - q);
        // Its largest is 1, so that no alpha leaves the range of the numbers.
        (self.a2 / d).powi(2) * (1.0 - 2.0 * q).max(0.0)
    }

    /// Calls `visit(block, weight)` for the blocks within `block`, the weight per solid angle.
    fn cut(&self, block: Block, texels: usize, visit: &mut impl FnMut(Block, f64)) {
        let q = self.squared_sine(block.middle());
        let angle = 2.0 * (q + self.a2).sqrt();
        if block.extent < texels && block.solid_angle().sqrt() > self.share * angle {
            for quarter in block.quarters() {
                self.cut(quarter, texels, visit);
            }
            return;
        }
        let weight = 0.25
            * block.quarters().map(|quarter| self.weight(quarter.middle())).iter().sum::<f64>();
        if weight > 0.0 {
            visit(block, weight);
        }
    }
}

/// Where the blocks with `extent` along a side begin in the list of all, the smallest first.
fn first_block(extent: usize, texels: usize) -> usize {
    let mut first = 0;
    let mut side = texels;
    while side > extent {
        first += 6 * side * side;
        side /= 2;
    }
    first
}

/// The means of a level with `extent` texels along a side, from blocks of up to `texels`.
fn level<T: Scalar>(
    extent: usize,
    texels: usize,
    roughness: f64,
) -> Result<SparseMatrix<T>, TensorError> {
    let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); 6 * extent * extent];
    for_each_item_mut(&mut rows, |index, row| {
        let towards = Block::from_index(index, extent).middle();
        let lobe = Lobe::new(towards, roughness);
        let mut sum = 0.0;
        for face in 0..6 {
            let whole = Block { face, row: 0, column: 0, extent: 1 };
            lobe.cut(whole, texels, &mut |block, weight| {
                sum += weight * block.solid_angle();
                let column = first_block(block.extent, texels) + block.index();
                row.push((column as u32, weight));
            });
        }
        // The columns hold radiance times solid angle: of the same radiance everywhere the mean is that
        // radiance.
        row.iter_mut().for_each(|(_, weight)| *weight /= sum);
    });
    let columns = first_block(1, texels) + 6;
    let entries = rows.iter().zip(0..).flat_map(|(row, index)| {
        row.iter().map(move |&(column, weight)| (index, column, T::from_f64(weight)))
    });
    SparseMatrix::new(rows.len(), columns, entries)
}

impl<T: Scalar> Prefilter<T> {
    /// The weights for cube maps of `extent` x `extent` texels a face, and for so many `levels` of roughness,
    /// from 0 to 1 in equal steps. Level k has `2^k` times fewer texels along a side. Three or four levels
    /// are usual: the last one should have 8 texels along a side or more.
    ///
    /// Each texel of a level but the first takes up to 7 kB of weights in `f32`, 8 kB where there are many
    /// levels: 50 MB for 64 texels along a side, and four times as much for 128.
    ///
    /// # Errors
    /// `TensorError::Value` unless the extent is a power of two up to 256, and there are from 1 level to as
    /// many as halve it to 1.
    pub fn new(extent: usize, levels: usize) -> Result<Self, RenderError> {
        if !extent.is_power_of_two() || extent > MOST_TEXELS {
            let rule = "an extent that is a power of two up to 256";
            return Err(RenderError::value(NAME, rule, extent as f64));
        }
        let most = extent.ilog2() as usize + 1;
        if !(1..=most).contains(&levels) {
            let rule = format!("from 1 to {most} levels for an extent of {extent}");
            return Err(RenderError::value(NAME, rule, levels as f64));
        }
        let rough = 1..levels;
        let matrix = |k: usize| level(extent >> k, extent, k as f64 / (levels - 1) as f64);
        let texel = |k: usize| Block::from_index(k, extent);
        let count = 6 * extent * extent;
        let mut of_texels: Vec<[f64; HARMONICS]> = vec![[0.0; HARMONICS]; count];
        for_each_item_mut(&mut of_texels, |k, sums| {
            let share = texel(k).solid_angle() / (PLACES * PLACES) as f64;
            for sample in 0..PLACES * PLACES {
                let point =
                    [sample % PLACES, sample / PLACES].map(|k| (k as f64 + 0.5) / PLACES as f64);
                let values = harmonics(texel(k).unit(point));
                sums.iter_mut().zip(values).for_each(|(sum, y)| *sum += share * y);
            }
        });
        Ok(Self {
            extent,
            levels: rough.map(matrix).collect::<Result<_, _>>()?,
            solid_angles: Tensor::from_flat_fn([6, extent, extent, 1], |k| {
                T::from_f64(texel(k).solid_angle())
            }),
            harmonics: Tensor::from_flat_fn([HARMONICS, count], |k| {
                T::from_f64(of_texels[k % count][k / count])
            }),
        })
    }

    /// The same weights in another precision.
    pub fn cast<U: Scalar>(&self) -> Prefilter<U> {
        Prefilter {
            extent: self.extent,
            levels: self.levels.iter().map(SparseMatrix::cast).collect(),
            solid_angles: self.solid_angles.cast(),
            harmonics: self.harmonics.cast(),
        }
    }

    /// # Errors
    /// [`RenderError::Shape`] unless texels are `[6, S, S, C]`, with the extent S and a channel or more.
    fn channels(&self, texels: Var<'_, T>) -> Result<usize, RenderError> {
        match *texels.shape() {
            [6, rows, columns, channels] if [rows, columns] == [self.extent; 2] && channels > 0 => {
                Ok(channels)
            }
            _ => {
                let rule = format!("texels of shape [6, {0}, {0}, C], with a channel", self.extent);
                Err(RenderError::shape(NAME, rule, &texels.shape()))
            }
        }
    }

    /// The coefficients of `texels: [6, S, S, C]` in the spherical harmonics of bands 0 to 2: `[9, C]`, in the
    /// order of [`irradiance`](crate::irradiance()).
    ///
    /// # Errors
    /// [`RenderError::Shape`] for texels of another shape.
    pub fn harmonics<'t>(&self, texels: Var<'t, T>) -> Result<Var<'t, T>, RenderError> {
        let channels = self.channels(texels)?;
        let rows = texels.reshape([6 * self.extent * self.extent, channels])?;
        Ok(texels.tape().constant(&self.harmonics).matmul(rows)?)
    }

    /// The mirror images of `texels: [6, S, S, C]` in surfaces of each level's roughness. Level 0 has the texels as
    /// they are.
    ///
    /// # Errors
    /// [`RenderError::Shape`] for texels of another shape.
    pub fn cube_map<'t>(&self, texels: Var<'t, T>) -> Result<CubeMap<'t, T>, RenderError> {
        let channels = self.channels(texels)?;
        let mut levels = vec![texels];
        if !self.levels.is_empty() {
            let blocks = self.blocks(texels, channels)?;
            for (k, matrix) in (1..).zip(&self.levels) {
                let extent = self.extent >> k;
                levels.push(matrix.product(blocks)?.reshape([6, extent, extent, channels])?);
            }
        }
        CubeMap::from_levels(&levels)
    }

    /// The radiance of all blocks times their solid angles, `[blocks, C]`: the smallest blocks first.
    fn blocks<'t>(&self, texels: Var<'t, T>, channels: usize) -> Result<Var<'t, T>, RenderError> {
        let mut light = texels.try_mul(texels.tape().constant(&self.solid_angles))?;
        let mut extent = self.extent;
        let mut all = Vec::new();
        loop {
            all.push(light.reshape([6 * extent * extent, channels])?);
            if extent == 1 {
                return Ok(Var::concat(&all, 0)?);
            }
            // Sums of four, which are four means.
            light = halved(light)? * T::from_f64(4.0);
            extent /= 2;
        }
    }
}

#[cfg(test)]
impl<T: Scalar> Prefilter<T> {
    /// The most blocks of a mean, level by level.
    pub(super) fn blocks_of_means(&self) -> Vec<usize> {
        let most =
            |matrix: &SparseMatrix<T>| (0..matrix.rows()).map(|i| matrix.row(i).0.len()).max();
        self.levels.iter().filter_map(most).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_has_few_blocks_whatever_the_size_of_the_map() {
        for (size, levels) in [(16, 2), (32, 4), (64, 4), (64, 7)] {
            let counts = Prefilter::<f32>::new(size, levels).unwrap().blocks_of_means();
            assert!(counts.iter().all(|&count| count <= 540), "{counts:?}");
        }
    }
}
