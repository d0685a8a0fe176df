//! Light from all sides, of our own.

use bokashi::glam::DVec3;
use bokashi::prelude::*;

use super::random::Random;

/// Waves of a colour, and bright spots.
const WAVES: usize = 12;
const SPOTS: usize = 8;

/// A cube map of radiance, `[6, side, side, 3]`: positive, without seams, about 0.5, and some bright spots
/// as of lamps, up to 2 brighter.
pub fn sky(side: usize, random: &mut Random) -> Tensor<f32> {
    let mut wave = |_| {
        let frequency = random.between(1.0, 8.0);
        (frequency * random.direction(), random.between(0.0, std::f64::consts::TAU), frequency)
    };
    let waves: [[_; WAVES]; 3] = std::array::from_fn(|_| std::array::from_fn(&mut wave));
    let spots: [_; SPOTS] = std::array::from_fn(|_| {
        let color = [(); 3].map(|()| random.between(0.5, 2.0));
        (random.direction(), random.between(0.1, 0.25), color)
    });
    let directions = CubeMap::<f64>::directions(side);
    Tensor::from_flat_fn([6, side, side, 3], |entry| {
        let (texel, channel) = (entry / 3, entry % 3);
        let towards = DVec3::from_slice(&directions.data()[3 * texel..]);
        let waves = waves[channel].iter();
        let sum: f64 = waves.map(|(wave, phase, f)| (wave.dot(towards) + phase).sin() / f).sum();
        let spots = spots.iter().map(|(center, radius, color)| {
            color[channel] * (-0.5 * (center.distance(towards) / radius).powi(2)).exp()
        });
        (0.5 * (0.5 * sum).exp() + spots.sum::<f64>()) as f32
    })
}

/// An environment and a lamp far away, as numbers that don't change.
#[derive(Debug, Clone)]
pub struct ConstantLights {
    harmonics: Tensor<f32>,
    reflections: Vec<Tensor<f32>>,
    direction: Tensor<f32>,
}

impl ConstantLights {
    /// The light of `sky`, `[6, S, S, 3]`, and of a white lamp in this direction.
    ///
    /// # Errors
    /// As [`Prefilter::new`] with 4 levels, and [`Environment::from_texels`].
    pub fn new(sky: &Tensor<f32>, direction: DVec3) -> Result<Self, RenderError> {
        let (tape, prefilter) = (Tape::new(), Prefilter::new(sky.shape()[1], 4)?);
        let Environment { harmonics, reflections } =
            Environment::from_texels(tape.constant(sky), &prefilter)?;
        let reflections = reflections.levels().iter().map(|level| level.value()).collect();
        let direction = Tensor::from(direction.as_vec3().to_array());
        Ok(Self { harmonics: harmonics.value(), reflections, direction })
    }

    /// The light on `tape`.
    ///
    /// # Errors
    /// None: those of [`CubeMap::from_levels`].
    pub fn on<'t>(
        &self,
        tape: &'t Tape<f32>,
    ) -> Result<(Environment<'t, f32>, Light<'t, f32>), RenderError> {
        let levels: Vec<_> = self.reflections.iter().map(|level| tape.constant(level)).collect();
        let reflections = CubeMap::from_levels(&levels)?;
        let harmonics = tape.constant(&self.harmonics);
        let (direction, irradiance) =
            (tape.constant(&self.direction), tape.constant_full([3], 1.0));
        let lamp = Light::Directional { direction, irradiance };
        Ok((Environment { harmonics, reflections }, lamp))
    }
}

/// The faces of a cube map, one below the other: a picture `[6 side, side, 3]`.
pub fn column(map: &Tensor<f32>) -> Tensor<f32> {
    let side = map.shape()[1];
    Tensor::from_flat_fn([6 * side, side, 3], |entry| map.data()[entry])
}
