//! How much memory files may ask for.
//!
//! A few bytes of a packed image are very many pixels. So what is made of files is counted by the sizes that
//! their headers say, before memory is taken, and held against a limit. By default that is half of what the
//! process may have: of the machine's memory, its control group's, or the addresses that it may use, whichever
//! is least. Counts are estimates from above for images and textures, and measured ones for drawing.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use crate::error::{Location, SceneError};

/// The limit where nothing says how much memory there is, in bytes.
const UNKNOWN: u64 = 4 << 30;
/// Bytes of a texel: three numbers of light, and a third of them again for smaller levels.
pub(crate) const OF_TEXEL: u64 = 16;
/// Bytes that a texel takes beside while its image becomes light.
pub(crate) const OF_NEW_TEXEL: u64 = 12;
/// Bytes of a number that is learnt: it, its gradient, what the optimizer and the tape keep, and its share of
/// results. Measured: 200 per texel of three.
pub(crate) const OF_LEARNT_NUMBER: u64 = 64;
/// Bytes of a pixel that is drawn and written: measured, 144 with all its files.
pub(crate) const OF_DRAWN_PIXEL: u64 = 144;
/// Bytes of a pixel that is drawn, compared and written: measured, 300.
pub(crate) const OF_FITTED_PIXEL: u64 = 300;

/// Bytes of a point of a field: its number and its colour, which are learnt, and what smoothing keeps.
pub(crate) const OF_POINT: u64 = 400;

/// Bytes of a face that is drawn: measured, 470.
pub(crate) const OF_FACE: u64 = 480;

/// The limit of this process.
static LIMIT: OnceLock<u64> = OnceLock::new();

/// Sets the limit of this process, in bytes: what is read of files may ask for no more memory. The first call
/// counts, before any file is read.
pub fn limit_memory(bytes: u64) {
    // Whoever was first wins.
    let _ = LIMIT.set(bytes);
}

/// The limit of this process, in bytes: that of [`limit_memory`], or by default half of the memory that the
/// process may have.
pub fn memory_limit() -> u64 {
    *LIMIT.get_or_init(|| available().map_or(UNKNOWN, |bytes| bytes / 2))
}

/// The memory that the process may have, where Linux says so.
fn available() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| machine_memory(&text));
    let groups = read("/proc/self/cgroup");
    let groups = groups.iter().flat_map(|text| group_limit_files(text));
    let groups = groups.filter_map(|path| fs::read_to_string(path).ok()?.trim().parse().ok());
    let addresses = read("/proc/self/limits").and_then(|text| address_limit(&text));
    machine.into_iter().chain(groups).chain(addresses).min()
}

/// The memory of a machine in the words of `/proc/meminfo`.
fn machine_memory(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// The files that limit the control groups of `/proc/self/cgroup`, and those above them: of both versions.
fn group_limit_files(text: &str) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for line in text.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(kinds), Some(group)) = (parts.next(), parts.next()) else { continue };
        let (root, file) = match kinds {
            "" => ("/sys/fs/cgroup", "memory.max"),
            kinds if kinds.split(',').any(|kind| kind == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => continue,
        };
        let groups = Path::new(group.trim_start_matches('/')).ancestors();
        files.extend(groups.map(|group| Path::new(root).join(group).join(file)));
    }
    files
}

/// The addresses that a process may use in the words of `/proc/self/limits`.
fn address_limit(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What the files of a folder have taken so far. Clones count together.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory(Arc<AtomicU64>);

impl Memory {
    /// Takes `bytes` for good, where there is room for `meanwhile` more. `what` needs them.
    ///
    /// # Errors
    /// [`SceneError::Memory`] beyond the limit; nothing is taken then.
    pub(crate) fn take(
        &self,
        bytes: u64,
        meanwhile: u64,
        location: &Location,
        what: impl Fn() -> String,
    ) -> Result<(), SceneError> {
        self.take_within(memory_limit(), bytes, meanwhile, location, what)
    }

    /// Whether there is room for `bytes`, which `what` needs for a time.
    ///
    /// # Errors
    /// [`SceneError::Memory`] beyond the limit.
    pub(crate) fn check(
        &self,
        bytes: u64,
        location: &Location,
        what: impl Fn() -> String,
    ) -> Result<(), SceneError> {
        self.take(0, bytes, location, what)
    }

    fn take_within(
        &self,
        limit: u64,
        bytes: u64,
        meanwhile: u64,
        location: &Location,
        what: impl Fn() -> String,
    ) -> Result<(), SceneError> {
        let all = bytes.saturating_add(meanwhile);
        let fits = |taken: u64| {
            let is_room = taken.checked_add(all).is_some_and(|all| all <= limit);
            is_room.then_some(taken.saturating_add(bytes))
        };
        let taken = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, fits);
        taken.map(drop).map_err(|taken| SceneError::Memory {
            location: location.clone(),
            what: what(),
            found: all,
            left: limit.saturating_sub(taken),
            most: limit,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_counts_together_and_what_is_checked_does_not() {
        let memory = Memory::default();
        let other = memory.clone();
        let location = Location::new("a.png");
        let take = |memory: &Memory, bytes, meanwhile| {
            memory.take_within(100, bytes, meanwhile, &location, || "an image".to_owned())
        };
        take(&memory, 0, 100).unwrap();
        take(&memory, 60, 40).unwrap();
        let message = take(&other, 0, 41).unwrap_err().to_string();
        let rule = "a.png: an image needs 41 bytes of memory, and 40 bytes of 100 bytes are left";
        assert!(message.starts_with(rule), "{message}");
        take(&other, 40, 0).unwrap();
        assert!(take(&memory, 1, 0).is_err());
        assert!(take(&memory, u64::MAX, u64::MAX).is_err());
    }

    #[test]
    fn the_systems_words_are_read() {
        assert_eq!(
            machine_memory("MemTotal:       24684092 kB\nMemFree: 1 kB\n"),
            Some(25_276_510_208)
        );
        assert_eq!(machine_memory("MemFree: 1 kB\n"), None);
        let limits = "Limit   Soft Limit   Hard Limit   Units\nMax address space         536870912            unlimited            bytes\n";
        assert_eq!(address_limit(limits), Some(536_870_912));
        assert_eq!(address_limit("Max address space  unlimited  unlimited  bytes\n"), None);
        let files = group_limit_files("4:memory:/a/b\n3:cpuset:/c\n0::/d\n");
        let files: Vec<_> = files.iter().map(|file| file.to_str().unwrap()).collect();
        let expected = [
            "/sys/fs/cgroup/memory/a/b/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/a/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/d/memory.max",
            "/sys/fs/cgroup/memory.max",
        ];
        assert_eq!(files, expected);
        if cfg!(target_os = "linux") {
            assert!(available().is_some_and(|bytes| bytes > 1 << 20));
        }
    }
}
