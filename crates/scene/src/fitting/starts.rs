//! A search for starts of poses: many rotations are tried on small images before a fit begins.
//!
//! A fit of a pose ends in a local minimum of its loss, the right one if the start is within some tens of degrees. Of
//! 64 rotations spread evenly over all rotations, the nearest is 30 degrees away in the mean, and at most some 60. So
//! such rotations about the mesh's middle are tried, the given pose first. Each takes a few steps on images so small
//! that a step costs next to nothing. The best go on with larger images, and the fit begins with the best of all.
//! Losses are those of the fit, over a few views.
//!
//! Several meshes are turned one after another, in their order, while the others keep the poses found so far.
//!
//! Each start is fitted on one thread, so its bits depend on no other start.
//!
//! # Source
//! Alexa, *Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)*, CVPR 2022, algorithm 1.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use bokashi_core::{Tensor, parallel};
use bokashi_fit::{
    Fit, FitError, FitSettings, Optimizer, Parameter, Parameters, Ranks, Schedule, View, agree,
    block, views,
};
use glam::{DQuat, DVec3};

use super::stage::{is_not_finite, loss_of_view};
use crate::error::SceneError;
use crate::learnables::{POSE, Values};
use crate::renderer::Renderer;
use crate::targets::{Targets, fit_error};

/// A level of the search. Each level goes on with the best starts of the level before.
struct Level {
    /// The most starts that are tried.
    count: usize,
    /// The most pixels along the shorter side of an image; at least half of them, where it has as many.
    side: usize,
    steps: u64,
    /// The learning rate of the first step, in radians and radii of the scene.
    rate: f64,
}

/// Few steps say which starts are hopeless. The first two levels together can turn a start by some 60 degrees.
const LEVELS: [Level; 4] = [
    Level { count: usize::MAX, side: 24, steps: 6, rate: 0.15 },
    Level { count: 20, side: 32, steps: 10, rate: 0.1 },
    Level { count: 6, side: 48, steps: 16, rate: 0.05 },
    Level { count: 2, side: 64, steps: 20, rate: 0.02 },
];

/// Of two starts whose rotations are less than so many degrees apart, one goes on.
const SAME: f64 = 10.0;

/// The start that was chosen for a pose.
pub(super) struct Start {
    /// The name of the parameter.
    pub(super) name: String,
    /// The value of the parameter.
    pub(super) motion: [f32; 6],
    /// The number of the start, from 0, and how many there are.
    number: usize,
    count: usize,
}

impl fmt::Display for Start {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, motion, number, count } = self;
        let degrees = turn(motion).angle_between(DQuat::IDENTITY).to_degrees();
        let number = number + 1;
        write!(f, "{name}: start {number} of {count}, {degrees:.0} degrees from the given one")
    }
}

/// A start under way, with its present motion and loss.
#[derive(Clone, Copy)]
struct Candidate {
    number: usize,
    loss: f64,
    motion: [f32; 6],
}

/// The bytes of a candidate.
const BYTES: usize = 40;

/// The fit for which starts are searched.
pub(super) struct Search<'a> {
    renderer: &'a Renderer,
    targets: &'a Targets,
    ranks: &'a Ranks<f32>,
    views: Vec<usize>,
    rotations: Vec<DQuat>,
}

impl<'a> Search<'a> {
    /// The search that the scene asks for, if it asks for one.
    pub(super) fn new(
        renderer: &'a Arc<Renderer>,
        targets: &'a Targets,
        ranks: &'a Ranks<f32>,
    ) -> Option<Self> {
        let scene = renderer.scene();
        let count = scene.description.learn.pose.as_ref()?.starts?.0;
        let rotations = rotations(count, scene.description.seed);
        Some(Self { renderer, targets, ranks, views: scene.searched_views(), rotations })
    }

    /// The best start of each pose that has several. All ranks make this call.
    ///
    /// # Errors
    /// Those of a step on the views.
    pub(super) fn best(&self, parameters: &Parameters<f32>) -> Result<Vec<Start>, SceneError> {
        let names = POSE.parameter_names(self.renderer.scene());
        let mut poses: Vec<Start> = names
            .into_iter()
            .filter(|name| parameters.get(name).is_ok())
            .map(|name| Start { name, motion: [0.0; 6], number: 0, count: self.rotations.len() })
            .collect();
        for index in 0..poses.len() {
            let starts = self.rotations.iter().enumerate().map(|(number, rotation)| {
                let [x, y, z] = rotation.to_scaled_axis().as_vec3().to_array();
                Candidate { number, loss: f64::INFINITY, motion: [0.0, 0.0, 0.0, x, y, z] }
            });
            let mut candidates: Vec<_> = starts.collect();
            for level in &LEVELS {
                candidates =
                    self.tried(level, &best_apart(&candidates, level.count), (&poses, index))?;
            }
            for best in best_apart(&candidates, 1) {
                (poses[index].number, poses[index].motion) = (best.number, best.motion);
            }
        }
        Ok(poses)
    }

    /// The candidates after the steps of a level. Each rank refines some of them.
    fn tried(
        &self,
        level: &Level,
        candidates: &[Candidate],
        poses: (&[Start], usize),
    ) -> Result<Vec<Candidate>, SceneError> {
        let (rank, size) = (self.ranks.rank(), self.ranks.size());
        let own = &candidates[block(candidates.len(), rank, size)];
        // One after another, before threads ask for all of them at once.
        let read = self.views.iter().try_for_each(|&view| {
            self.targets.get(view, self.reduce(level, view)).map(drop).map_err(fit_error)
        });
        let mut results: Vec<_> = own.iter().map(|_| None).collect();
        parallel::write_each(&mut results, 1, |k| {
            Some(parallel::alone(|| self.refined(level, &own[k], poses)))
        });
        let tried: Result<Vec<_>, FitError> = results.into_iter().flatten().collect();
        let tried = read.and(tried);
        let bytes =
            tried.map(|all| all.iter().flat_map(|candidate| candidate.to_bytes()).collect());
        let all = agree(&**self.ranks, bytes)?;
        Ok(all.iter().flat_map(|bytes| bytes.as_chunks().0).map(Candidate::from_bytes).collect())
    }

    /// The factor by which the image of a view is smaller at a level.
    fn reduce(&self, level: &Level, view: usize) -> usize {
        let size = self.renderer.scene().views[view].camera.size;
        size.width.min(size.height).div_ceil(level.side)
    }

    /// A candidate after the steps of a level: its motion with the least loss.
    fn refined(
        &self,
        level: &Level,
        candidate: &Candidate,
        (poses, index): (&[Start], usize),
    ) -> Result<Candidate, FitError> {
        let mut parameters = Parameters::new();
        for (k, Start { name, motion, .. }) in poses.iter().enumerate() {
            let parameter = match k == index {
                true => Parameter::new(name, Tensor::from(candidate.motion)).rate(level.rate),
                false => Parameter::new(name, Tensor::from(*motion)).frozen(),
            };
            // From some starts a mesh is not seen.
            parameters = parameters.with(parameter.optional())?;
        }
        let mut pipeline = views(self.views.len(), |view: View, tape, variables| {
            let (values, view) = (Values { tape, learnt: Some(variables) }, self.views[view.index]);
            let reduce = self.reduce(level, view);
            loss_of_view(self.renderer, self.targets, &values, view, reduce)
        });
        let settings = FitSettings {
            steps: level.steps,
            schedule: Schedule::Cosine { steps: level.steps, floor: 0.1 },
            optimizer: Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 },
            ..FitSettings::default()
        };
        let mut fit = Fit::new(parameters, settings)?;
        let mut best = Candidate { loss: f64::INFINITY, ..*candidate };
        for _ in 0..level.steps {
            let before = fit.parameters().value(&poses[index].name)?;
            let loss = match fit.step(&mut pipeline) {
                Ok(stepped) => stepped.loss,
                // It has left the range of the numbers, and others may be better.
                Err(error) if is_not_finite(&error) => break,
                Err(error) => return Err(error),
            };
            if loss < best.loss {
                best.loss = loss;
                best.motion = std::array::from_fn(|k| before.data()[k]);
            }
        }
        Ok(best)
    }
}

impl Candidate {
    fn to_bytes(self) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        bytes[..8].copy_from_slice(&(self.number as u64).to_le_bytes());
        bytes[8..16].copy_from_slice(&self.loss.to_le_bytes());
        for (bytes, number) in bytes[16..].chunks_exact_mut(4).zip(self.motion) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    fn from_bytes(bytes: &[u8; BYTES]) -> Self {
        let word = |k: usize| std::array::from_fn(|byte| bytes[8 * k + byte]);
        let number = |k: usize| std::array::from_fn(|byte| bytes[16 + 4 * k + byte]);
        Self {
            number: u64::from_le_bytes(word(0)) as usize,
            loss: f64::from_le_bytes(word(1)),
            motion: std::array::from_fn(|k| f32::from_le_bytes(number(k))),
        }
    }
}

/// At most `count` candidates, from the best on, whose rotations are all [`SAME`] apart and more; the first of equal
/// ones.
fn best_apart(candidates: &[Candidate], count: usize) -> Vec<Candidate> {
    if count >= candidates.len() {
        return candidates.to_vec();
    }
    let mut sorted = candidates.to_vec();
    sorted.sort_by(|a, b| a.loss.total_cmp(&b.loss).then(a.number.cmp(&b.number)));
    let mut best: Vec<Candidate> = Vec::new();
    for candidate in sorted {
        let rotation = turn(&candidate.motion);
        let is_near =
            |other: &Candidate| rotation.angle_between(turn(&other.motion)).to_degrees() < SAME;
        if best.len() < count && !best.iter().any(is_near) {
            best.push(candidate);
        }
    }
    best
}

/// The rotation of a motion.
fn turn(motion: &[f32; 6]) -> DQuat {
    let [.., x, y, z] = motion.map(f64::from);
    DQuat::from_scaled_axis(DVec3::new(x, y, z))
}

/// `count` rotations that are spread evenly, the identity first.
///
/// `q_k` lie on a spiral; `g q_k q_0^-1 g^-1` are as even, and begin with the identity. `g` follows from the seed.
fn rotations(count: usize, seed: u64) -> Vec<DQuat> {
    let first = spiral(0, count).inverse();
    // Shares of 1 by powers of the root of x^4 = x + 1, as parts of 2^64.
    let shares = [0xd1b5_4a32_d192_ed03_u64, 0xabc9_8388_fb8f_ac03, 0x8cb9_2ba7_2f3d_8dd7];
    let [square, a, b] =
        shares.map(|share| (seed.wrapping_mul(share) >> 11) as f64 / 2f64.powi(53));
    let turned = on_circles(square, TAU * a, TAU * b);
    let all = (0..count).map(|k| match k {
        0 => DQuat::IDENTITY,
        _ => turned * spiral(k, count) * first * turned.inverse(),
    });
    all.map(|rotation| if rotation.w < 0.0 { -rotation } else { rotation }).collect()
}

/// The k-th of `count` rotations on a super-Fibonacci spiral.
fn spiral(k: usize, count: usize) -> DQuat {
    // The root of 2, and the root of psi^4 = psi + 4.
    let (phi, psi) = (std::f64::consts::SQRT_2, 1.533_751_168_755_204_3);
    let s = k as f64 + 0.5;
    on_circles(s / count as f64, TAU * s / phi, TAU * s / psi)
}

/// A unit quaternion whose parts in two planes have these angles, and the first this squared length.
fn on_circles(square: f64, a: f64, b: f64) -> DQuat {
    let (r, rest) = (square.sqrt(), (1.0 - square).sqrt());
    DQuat::from_xyzw(r * a.sin(), r * a.cos(), rest * b.sin(), rest * b.cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(a: DQuat, b: DQuat) -> f64 {
        a.angle_between(b).to_degrees()
    }

    #[test]
    fn rotations_are_spread_evenly_from_the_identity() {
        for seed in [0, 1, 7, u64::MAX] {
            let all = rotations(64, seed);
            assert_eq!(all[0], DQuat::IDENTITY);
            assert!(all.iter().all(|rotation| (rotation.length() - 1.0).abs() < 1e-12));
            let nearest = |of: DQuat, skip: usize| {
                let others = all.iter().enumerate().filter(|(k, _)| *k != skip);
                others.map(|(_, other)| degrees(of, *other)).fold(f64::INFINITY, f64::min)
            };
            let apart = (0..64).map(|k| nearest(all[k], k)).fold(f64::INFINITY, f64::min);
            // Of many others none is far from all.
            let far = rotations(5000, seed + u64::from(seed < 9));
            let far = far.into_iter().map(|of| nearest(of, 64)).fold(0.0, f64::max);
            println!("seed {seed}: {apart:.1} apart, {far:.1} far");
            assert!(apart > 37.0 && far < 62.0, "seed {seed}: {apart} apart, {far} far");
        }
        assert_ne!(rotations(64, 0)[1], rotations(64, 1)[1]);
        assert_eq!(rotations(1, 5), [DQuat::IDENTITY]);
    }

    #[test]
    fn of_equal_candidates_the_first_is_the_best() {
        let candidate = |number: usize, loss: f64, angle: f32| Candidate {
            number,
            loss,
            motion: [0.0, 0.0, 0.0, angle, 0.0, 0.0],
        };
        let all = [
            candidate(2, 1.0, 0.5),
            candidate(0, 1.0, 1.5),
            candidate(1, 2.0, 3.0),
            candidate(3, 1.1, 1.51),
        ];
        let numbers = |count| -> Vec<_> {
            best_apart(&all, count).iter().map(|candidate| candidate.number).collect()
        };
        assert_eq!(numbers(1), [0]);
        // One that is turned as a better one makes place for another.
        assert_eq!(numbers(3), [0, 2, 1]);
        let bytes = all[3].to_bytes();
        assert_eq!(Candidate::from_bytes(&bytes).to_bytes(), bytes);
        assert_eq!(Candidate::from_bytes(&bytes).motion, all[3].motion);
    }
}
