//! What the times were taken on.

use std::{fmt, fs, thread};

use serde::Serialize;

/// What the times were taken on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// The processor's name, where the system tells it.
    pub processor: Option<String>,
    /// How many cores there are.
    pub cores: usize,
    /// The compiler and its version.
    pub compiler: &'static str,
    /// The flags it was given beside the profile's.
    pub flags: &'static str,
    /// The optimization level of the build.
    pub opt_level: &'static str,
    /// What it compiled for.
    pub target: &'static str,
}

impl Machine {
    /// This one.
    pub fn here() -> Self {
        // Linux alone has this file; elsewhere the name stays unknown.
        let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let name = info.lines().find_map(|line| line.strip_prefix("model name"));
        let name = name.and_then(|rest| rest.split_once(':')).map(|(_, name)| name.trim());
        Self {
            processor: name.map(str::to_owned),
            cores: thread::available_parallelism().map_or(1, usize::from),
            compiler: env!("BENCH_COMPILER"),
            flags: env!("BENCH_FLAGS"),
            opt_level: env!("BENCH_OPT_LEVEL"),
            target: env!("BENCH_TARGET"),
        }
    }
}

/// One sentence.
impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { processor, cores, compiler, flags, opt_level, target } = self;
        let processor = processor.as_deref().unwrap_or("a processor without a name");
        write!(
            f,
            "{processor}, {cores} cores; {compiler} for {target}, optimization level {opt_level}, \
             flags: {flags}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_compiler_and_flags_are_named() {
        let said = Machine::here().to_string();
        assert!(said.contains("cores; rustc 1.") && said.contains("flags: "), "{said}");
    }
}
