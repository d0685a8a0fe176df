#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    bokashi_fuzz::pictures(bytes);
});
