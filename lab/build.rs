//! Notes the compiler and its flags, which every table of times names.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let asked = Command::new(env::var_os("RUSTC").unwrap_or("rustc".into())).arg("-V").output();
    let compiler = asked.ok().and_then(|said| String::from_utf8(said.stdout).ok());
    let compiler = compiler.map_or("an unknown compiler".to_owned(), |said| said.trim().to_owned());
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default().replace('\x1f', " ");
    let flags = if flags.is_empty() { "none".to_owned() } else { flags };
    let optimized = env::var("OPT_LEVEL").unwrap_or_default();
    let target = env::var("TARGET").unwrap_or_default();
    println!("cargo::rustc-env=BENCH_COMPILER={compiler}");
    println!("cargo::rustc-env=BENCH_FLAGS={flags}");
    println!("cargo::rustc-env=BENCH_OPT_LEVEL={optimized}");
    println!("cargo::rustc-env=BENCH_TARGET={target}");
}
