//! Random numbers that follow from a seed.

use bokashi::glam::{DMat4, DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A generator of random numbers: the same on every machine.
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The generator of `seed`. Streams of one seed are independent: one for each step, say.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Normally distributed, with variance 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Uniform in a cube around 0 of half this side.
    pub fn vector(&mut self, half: f64) -> DVec3 {
        DVec3::from_array([(); 3].map(|()| self.between(-half, half)))
    }

    /// Uniform among rotations.
    pub fn rotation(&mut self) -> DQuat {
        // Four normal numbers have no preferred direction.
        let [x, y, z, w] = [(); 4].map(|()| self.normal());
        DQuat::from_xyzw(x, y, z, w).normalize()
    }

    /// Uniform among directions.
    pub fn direction(&mut self) -> DVec3 {
        DVec3::from_array([(); 3].map(|()| self.normal())).normalize()
    }

    /// A camera's view of what is at 0, from any side, at this distance and moved by so much.
    pub fn view(&mut self, distance: f64, moved: f64) -> DMat4 {
        let position = self.vector(moved) + DVec3::new(0.0, 0.0, distance);
        DMat4::from_rotation_translation(self.rotation(), position)
    }

    /// A small motion: turned by up to `angle`, in radians, and moved by up to `length` along each axis.
    pub fn nearby(&mut self, angle: f64, length: f64) -> DMat4 {
        let turn = DQuat::from_axis_angle(self.direction(), self.between(0.0, angle));
        DMat4::from_rotation_translation(turn, self.vector(length))
    }
}
