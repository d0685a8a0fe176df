//! dev only
use super::exact::{exact, picture};
use super::*;
use crate::rasterize::options::Limits;
use std::time::Instant;

pub(super) struct Rng(pub u64);
impl Rng {
    pub(super) fn f(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mut x = self.0;
        x ^= x >> 33;
        x = x.wrapping_mul(0xff51afd7ed558ccd);
        x ^= x >> 33;
        (x >> 11) as f64 / (1u64 << 53) as f64
    }
    pub(super) fn r(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.f()
    }
}

pub(super) struct S {
    pub clip: Clip,
    pub faces: Vec<[u32; 3]>,
    pub size: usize,
}

pub(super) fn sphere(rows: u32, size: usize) -> S {
    // 2 rows * rows faces ~ 2*rows*rows*... rows x (2 rows) quads
    let cols = rows * 2;
    let mut clip = Clip::new();
    for i in 0..=rows {
        for j in 0..cols {
            let t = std::f64::consts::PI * f64::from(i) / f64::from(rows);
            let p = 2.0 * std::f64::consts::PI * f64::from(j) / f64::from(cols) + 0.3;
            let (x, y, z) = (t.sin() * p.cos(), t.cos(), t.sin() * p.sin());
            let (x, y, z) = (x, 0.9 * y - 0.435 * z, 0.435 * y + 0.9 * z);
            clip.push([0.83 * x + 0.01, 0.81 * y - 0.02, 0.6 * z, 1.0]);
        }
    }
    let mut faces = vec![];
    for i in 0..rows {
        for j in 0..cols {
            let v = |i: u32, j: u32| i * cols + j % cols;
            faces.push([v(i, j), v(i + 1, j), v(i, j + 1)]);
            faces.push([v(i, j + 1), v(i + 1, j), v(i + 1, j + 1)]);
        }
    }
    S { clip, faces, size }
}

pub(super) fn triangles(n: u32, size: usize, seed: u64, w: bool) -> S {
    let mut g = Rng(seed);
    let mut clip = Clip::new();
    for _ in 0..n {
        for _ in 0..3 {
            let w = if w { g.r(0.5, 2.0) } else { 1.0 };
            clip.push([g.r(-1.0, 1.0) * w, g.r(-1.0, 1.0) * w, g.r(-0.9, 0.9) * w, w]);
        }
    }
    S { clip, faces: (0..n).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), size }
}

/// small triangles of extent e
pub(super) fn small(n: u32, size: usize, seed: u64, e: f64) -> S {
    let mut g = Rng(seed);
    let mut clip = Clip::new();
    for _ in 0..n {
        let c = [g.r(-1.0, 1.0), g.r(-1.0, 1.0), g.r(-0.9, 0.9)];
        for _ in 0..3 {
            clip.push([c[0] + g.r(-e, e), c[1] + g.r(-e, e), c[2] + g.r(-0.1, 0.1) * e, 1.0]);
        }
    }
    S { clip, faces: (0..n).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), size }
}

/// thin blades around a point in a pixel of 1 x 1
pub(super) fn fan(n: u32, seed: u64, wide: f64) -> S {
    let mut g = Rng(seed);
    let mut clip = Clip::new();
    for k in 0..n {
        let a = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(n);
        let b = a + wide * 2.0 * std::f64::consts::PI / f64::from(n);
        let d = g.r(-0.5, 0.5);
        clip.push([0.1, 0.07, d, 1.0]);
        clip.push([0.1 + 0.8 * a.cos(), 0.07 + 0.8 * a.sin(), d + g.r(-0.2, 0.2), 1.0]);
        clip.push([0.1 + 0.8 * b.cos(), 0.07 + 0.8 * b.sin(), d + g.r(-0.2, 0.2), 1.0]);
    }
    S { clip, faces: (0..n).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), size: 1 }
}

pub(super) fn wheel(n: u32) -> S {
    let mut clip: Clip = vec![[0.1, 0.07, 0.0, 1.0]];
    for k in 0..n {
        let a = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(n);
        clip.push([0.1 + 0.8 * a.cos(), 0.07 + 0.8 * a.sin(), 0.0, 1.0]);
    }
    S { clip, faces: (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect(), size: 1 }
}

pub(super) fn hair(n: u32, seed: u64, width: f64) -> S {
    let mut g = Rng(seed);
    let mut clip = Clip::new();
    for _ in 0..n {
        let p = [g.r(-1.5, 1.5), g.r(-1.5, 1.5), g.r(-0.9, 0.9)];
        let q = [g.r(-1.5, 1.5), g.r(-1.5, 1.5), g.r(-0.9, 0.9)];
        let d = [q[1] - p[1], p[0] - q[0]];
        let l = width / d[0].hypot(d[1]);
        clip.push([p[0], p[1], p[2], 1.0]);
        clip.push([q[0], q[1], q[2], 1.0]);
        clip.push([q[0] + l * d[0], q[1] + l * d[1], q[2], 1.0]);
    }
    S { clip, faces: (0..n).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), size: 1 }
}

pub(super) struct Out {
    pub image: Vec<f64>,
    pub grad: Vec<f64>,
    pub ms: [f64; 2],
    pub counts: crate::boundary::BoundaryCounts,
}

pub(super) fn run(s: &S, k: usize, limits: Limits, seams: bool) -> Out {
    let mut mesh = Mesh::new(s.faces.clone(), s.clip.len()).unwrap();
    if seams {
        mesh = mesh.with_seams(|_, _| true);
    }
    let size = Size::square(s.size * k);
    let options = RasterOptions { limits, ..exact(size) };
    let colors = Tensor::from_flat_fn([s.clip.len(), 2], |k| ((k * 29 + 5) % 13) as f64 / 13.0);
    let tape = Tape::<f64>::new();
    let positions = tape.leaf(&tensor(&s.clip));
    let start = Instant::now();
    let fragments = rasterize(positions, &mesh, options).unwrap();
    let forward = start.elapsed().as_secs_f64() * 1e3;
    let counts = fragments.coverage.boundary_counts();
    drop(fragments);
    let image = picture(positions, tape.leaf(&colors), &mesh, options);
    let n = s.size;
    let up = Tensor::from_flat_fn([n * k, n * k, 2], |e| {
        let (row, column, c) = (e / 2 / (n * k) / k, e / 2 % (n * k) / k, e % 2);
        let at = (row * n + column) * 2 + c;
        (((at * 37 + 11) % 17) as f64 / 17.0 - 0.4) / (k * k) as f64
    });
    let start = Instant::now();
    let grad = tape.vjp(&[(image, &up)]).unwrap().get_or_zeros(positions).data().to_vec();
    let backward = start.elapsed().as_secs_f64() * 1e3;
    let mut means = vec![0.0; 2 * n * n];
    for (e, v) in image.value().data().iter().enumerate() {
        let (row, column, c) = (e / 2 / (n * k) / k, e / 2 % (n * k) / k, e % 2);
        means[(row * n + column) * 2 + c] += v / (k * k) as f64;
    }
    Out { image: means, grad, ms: [forward, backward], counts }
}

pub(super) fn errors(a: &Out, b: &Out) -> [f64; 2] {
    let e = a.image.iter().zip(&b.image).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let n: f64 = b.grad.iter().map(|g| g * g).sum::<f64>().sqrt();
    let d: f64 = a.grad.iter().zip(&b.grad).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    [e, d / n]
}

fn scenes() -> Vec<(&'static str, S, usize)> {
    vec![
        ("sphere20k@8", sphere(71, 8), 8),
        ("sphere80k@8", sphere(142, 8), 16),
        ("triangles500@4", triangles(500, 4, 1, false), 4),
        ("triangles2000@4", triangles(2000, 4, 1, true), 8),
        ("triangles5000@4", triangles(5000, 4, 1, false), 16),
        ("small3000@1", small(3000, 1, 1, 0.1), 16),
        ("small10000@1", small(10000, 1, 1, 0.05), 32),
        ("small100000@1", small(100000, 1, 1, 0.02), 64),
        ("fan3000", fan(3000, 1, 3.0), 0),
        ("fan10000", fan(10000, 1, 3.0), 0),
        ("wheel10000", wheel(10000), 0),
        ("wheel100000", wheel(100000), 0),
        ("hair1000", hair(1000, 1, 0.01), 16),
        ("hair3000", hair(3000, 1, 0.01), 32),
        ("hair10000", hair(10000, 1, 0.003), 0),
        ("hair100000", hair(100000, 1, 0.001), 0),
    ]
}

#[test]
#[ignore]
fn bench() {
    let var = |n: &str, d: usize| std::env::var(n).ok().map_or(d, |v| v.parse().unwrap());
    let d = Limits::DEFAULT;
    let limits = Limits {
        faces: var("FACES", d.faces),
        faces_of_cell: var("CELL", d.faces_of_cell),
        cuts: 1 << var("CUTS", d.cuts.ilog2() as usize),
        depth: var("DEPTH", d.depth as usize) as u32,
        work: 1 << var("WORK", d.work.ilog2() as usize),
    };
    let only = std::env::var("ONLY").unwrap_or_default();
    for (name, s, k) in scenes() {
        if !name.contains(&only) {
            continue;
        }
        let out = run(&s, 1, limits, true);
        let c = out.counts;
        print!(
            "{name:16} {:8.1} {:8.1} ms  crowded {:3} sampled {:.1e} pieces {}",
            out.ms[0], out.ms[1], c.crowded, c.sampled, c.pieces
        );
        let k = var("K", k);
        if var("REF", 0) == 1 && k > 0 {
            let reference = run(&s, k, Limits { work: 1 << 30, ..d }, true);
            let [e, g] = errors(&out, &reference);
            print!(
                "  error {e:.1e} {g:.1e} (ref crowded {} sampled {:.1e} dropped {} {:.0} ms)",
                reference.counts.crowded,
                reference.counts.sampled / (k * k) as f64,
                reference.counts.dropped,
                reference.ms[0]
            );
        }
        println!();
    }
}
