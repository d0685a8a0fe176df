#![no_main]

libfuzzer_sys::fuzz_target!(init: bokashi_fuzz::let_guarded_panics_pass(), |bytes: &[u8]| {
    bokashi_fuzz::image_file(bytes);
});
