//! What was published last, and its versions.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use super::snapshot::{Ended, Snapshot, View};

/// A curve is sent with so many points at most.
const MOST_POINTS: usize = 600;

/// What a request sees: a snapshot, and since which version each of its parts is as it is.
#[derive(Debug)]
pub(super) struct Published {
    version: u64,
    snapshot: Option<Snapshot>,
    /// Of each view: of its picture, its target and its difference.
    views: Vec<[u64; 3]>,
    mesh: u64,
}

/// The state that the fit and the server share. Its lock is held while a pointer is copied, and never
/// while a browser is served.
#[derive(Debug)]
pub(super) struct Shared {
    now: Mutex<Arc<Published>>,
    /// Held from one version to the next.
    publishing: Mutex<()>,
}

impl Shared {
    /// Nothing published yet. The first version is the time in milliseconds: a browser that waits
    /// for a program to start anew takes its first version for another than the last it saw.
    pub(super) fn new() -> Self {
        let time = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let version = u64::try_from(time.as_millis()).unwrap_or(0);
        let published = Published { version, snapshot: None, views: Vec::new(), mesh: version };
        Self { now: Mutex::new(Arc::new(published)), publishing: Mutex::new(()) }
    }

    /// What was published last.
    pub(super) fn now(&self) -> Arc<Published> {
        Arc::clone(&self.now.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Puts a snapshot in the place of the last one.
    pub(super) fn publish(&self, snapshot: Snapshot) {
        let _alone = self.publishing.lock().unwrap_or_else(PoisonError::into_inner);
        let next = Arc::new(Published::after(&self.now(), snapshot));
        let last = {
            let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *now, next)
        };
        // Its memory is given back outside of the lock.
        drop(last);
    }
}

/// The version since which `new` is as it is.
fn since(old: Option<(&Arc<[u8]>, u64)>, new: &Arc<[u8]>, version: u64) -> u64 {
    match old {
        Some((old, since)) if Arc::ptr_eq(old, new) || old == new => since,
        _ => version,
    }
}

/// The picture, the target and the difference of a view.
fn files(view: &View) -> [&Arc<[u8]>; 3] {
    [&view.picture, &view.target, &view.difference]
}

impl Published {
    fn after(last: &Self, snapshot: Snapshot) -> Self {
        let version = last.version + 1;
        let before = last.snapshot.as_ref();
        let views = snapshot.views.iter().enumerate().map(|(index, new)| {
            let old = before.and_then(|before| before.views.get(index)).zip(last.views.get(index));
            let (new, old) = (files(new), old.map(|(view, since)| (files(view), since)));
            std::array::from_fn(|part| {
                let old = old.map(|(files, since)| (files[part], since[part]));
                since(old, new[part], version)
            })
        });
        let views = views.collect();
        let mesh = match &snapshot.mesh {
            Some(new) => {
                let old = before.and_then(|before| before.mesh.as_ref());
                since(old.map(|old| (old, last.mesh)), new, version)
            }
            None => version,
        };
        Self { version, snapshot: Some(snapshot), views, mesh }
    }

    /// Its number: each is larger than the one before.
    pub(super) fn version(&self) -> u64 {
        self.version
    }

    /// A PNG file of the view `index`: its `picture`, `target` or `difference`.
    pub(super) fn picture(&self, index: usize, part: &str) -> Option<Arc<[u8]>> {
        let view = self.snapshot.as_ref()?.views.get(index)?;
        let part = ["picture", "target", "difference"].iter().position(|name| *name == part)?;
        Some(Arc::clone(files(view)[part]))
    }

    /// The mesh, where there is one.
    pub(super) fn mesh(&self) -> Option<Arc<[u8]>> {
        self.snapshot.as_ref()?.mesh.clone()
    }

    /// All but the pictures and the mesh, which are named by their versions. What is not finite is
    /// `null`.
    pub(super) fn json(&self) -> String {
        let Some(snapshot) = &self.snapshot else {
            return json!({ "version": self.version, "begun": false }).to_string();
        };
        let views =
            snapshot.views.iter().zip(&self.views).map(|(view, [picture, target, difference])| {
                json!({
                    "name": view.name, "held_out": view.held_out, "psnr": view.psnr,
                    "picture": picture, "target": target, "difference": difference,
                })
            });
        let ended = snapshot.ended.as_ref().map(|ended| match ended {
            Ended::Done(message) => json!({ "failed": false, "message": message }),
            Ended::Failed(message) => json!({ "failed": true, "message": message }),
        });
        json!({
            "version": self.version,
            "begun": true,
            "title": snapshot.title,
            "step": snapshot.step,
            "steps": snapshot.steps,
            "seconds": snapshot.seconds,
            "seconds_left": seconds_left(snapshot),
            "loss": snapshot.loss,
            "losses": thinned(&snapshot.losses),
            "held_out": thinned(&snapshot.held_out),
            "views": views.collect::<Vec<Value>>(),
            "mesh": snapshot.mesh.as_ref().map(|_| self.mesh),
            "ended": ended,
        })
        .to_string()
    }
}

/// How long the rest takes where its steps take as long as those of this run did.
fn seconds_left(snapshot: &Snapshot) -> Option<f64> {
    let done = snapshot.step.checked_sub(snapshot.first_step).filter(|&done| done > 0)?;
    let left = snapshot.steps.checked_sub(snapshot.step)?;
    Some(snapshot.seconds / done as f64 * left as f64)
}

/// A curve with few points: of each stretch the lowest and the highest, and the last point of all.
fn thinned(curve: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if curve.len() <= MOST_POINTS {
        return curve.to_vec();
    }
    let stretch = curve.len().div_ceil(MOST_POINTS / 2 - 1);
    let mut thin = Vec::with_capacity(MOST_POINTS);
    for points in curve.chunks(stretch) {
        let all = || points.iter().enumerate().filter(|(_, point)| point.1.is_finite());
        let low = all().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let high = all().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        // Where no value is finite, the first stands for the gap.
        let (low, high) = (low.map_or(0, |(index, _)| index), high.map_or(0, |(index, _)| index));
        thin.push(points[low.min(high)]);
        if low != high {
            thin.push(points[low.max(high)]);
        }
    }
    if let Some(&last) = curve.last().filter(|last| thin.last() != Some(last)) {
        thin.push(last);
    }
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(picture: &[u8]) -> View {
        let (target, difference) = (b"target"[..].into(), b"difference"[..].into());
        let (name, picture) = ("front".to_owned(), picture.into());
        View { name, held_out: true, psnr: Some(f64::INFINITY), picture, target, difference }
    }

    fn read(shared: &Shared) -> Value {
        serde_json::from_str(&shared.now().json()).expect("JSON")
    }

    #[test]
    fn versions_grow_with_every_publication_and_parts_that_stay_keep_theirs() {
        let shared = Shared::new();
        let empty = read(&shared);
        assert_eq!(empty["begun"], false);
        let mesh: Arc<[u8]> = b"mesh"[..].into();
        let publish = |picture: &[u8], mesh: Option<&Arc<[u8]>>| {
            let (views, mesh) = (vec![view(picture)], mesh.cloned());
            shared.publish(Snapshot { views, mesh, ..Snapshot::default() });
            read(&shared)
        };
        let first = publish(b"1", Some(&mesh));
        let second = publish(b"2", Some(&mesh));
        let third = publish(b"2", Some(&b"other"[..].into()));
        let number = |value: &Value| value.as_u64().expect("a whole number");
        let versions = [&empty, &first, &second, &third].map(|state| number(&state["version"]));
        assert!(versions.is_sorted_by(|a, b| a < b), "{versions:?}");
        let of = |state: &Value, part: &str| number(&state["views"][0][part]);
        assert!(of(&first, "picture") < of(&second, "picture"));
        assert_eq!(of(&second, "picture"), of(&third, "picture"));
        assert_eq!(of(&first, "target"), of(&third, "target"));
        assert_eq!(of(&first, "difference"), of(&third, "difference"));
        assert_eq!(first["mesh"], second["mesh"]);
        assert!(number(&second["mesh"]) < number(&third["mesh"]));
        assert!(publish(b"2", None)["mesh"].is_null());
        assert_eq!(first["views"][0]["held_out"], true);
        assert!(first["views"][0]["psnr"].is_null());
    }

    #[test]
    fn the_rest_is_reckoned_from_the_steps_of_this_run() {
        let left = |first_step, step, steps| {
            let snapshot =
                Snapshot { first_step, step, steps, seconds: 10.0, ..Snapshot::default() };
            seconds_left(&snapshot)
        };
        assert_eq!(left(0, 20, 100), Some(40.0));
        assert_eq!(left(50, 60, 100), Some(40.0));
        assert_eq!(left(0, 100, 100), Some(0.0));
        assert_eq!((left(0, 0, 100), left(50, 40, 100), left(0, 101, 100)), (None, None, None));
    }

    #[test]
    fn a_long_curve_keeps_its_ends_its_order_and_its_extremes() {
        for count in [0, 1, MOST_POINTS, MOST_POINTS + 1, 12_345] {
            let mut curve: Vec<_> = (0..count).map(|at| (at as f64, (at as f64).sin())).collect();
            if count > 1000 {
                (curve[777].1, curve[778].1) = (-50.0, 50.0);
            }
            let thin = thinned(&curve);
            assert!(thin.len() <= MOST_POINTS.min(count), "{count}: {}", thin.len());
            assert_eq!(thin.last(), curve.last());
            assert!(thin.is_sorted_by(|a, b| a.0 < b.0));
            let ends = |curve: &[(f64, f64)]| {
                let each = || curve.iter().map(|point| point.1);
                (each().fold(f64::INFINITY, f64::min), each().fold(f64::NEG_INFINITY, f64::max))
            };
            assert_eq!(ends(&thin), ends(&curve));
        }
    }

    #[test]
    fn what_is_not_finite_is_null_and_never_breaks_the_state() {
        let shared = Shared::new();
        let losses = vec![(0.0, f64::NAN), (1.0, f64::INFINITY), (2.0, 3.0)];
        let ended = Some(Ended::Failed("a loss was \"NaN\"".to_owned()));
        let (loss, seconds) = (f64::NAN, f64::NAN);
        shared.publish(Snapshot { loss, seconds, losses, ended, ..Snapshot::default() });
        let state = read(&shared);
        assert!(state["loss"].is_null() && state["seconds"].is_null());
        assert_eq!(state["losses"], json!([[0.0, null], [1.0, null], [2.0, 3.0]]));
        assert_eq!(state["ended"], json!({ "failed": true, "message": "a loss was \"NaN\"" }));
    }
}
