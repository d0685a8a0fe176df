//! The circumstances of a run.

use bokashi_report::About;

/// What a report says of this run of `program`.
pub fn about(program: &str) -> About {
    let arguments = std::env::args_os().skip(1);
    let words: Vec<_> = arguments.map(|word| word.to_string_lossy().into_owned()).collect();
    About {
        program: format!("{program} {}", env!("CARGO_PKG_VERSION")),
        command: format!("{program} {}", words.join(" ")).trim_end().to_owned(),
        threads: rayon::current_num_threads(),
    }
}
