//! Processor class of the networks: classes differ in the last bits of products and exponentials.

/// Returns the class of the processor: for x86-64 its microarchitecture level (`x86_64`,
/// `x86_64-v2`, `x86_64-v3`, `x86_64-v4`), otherwise the architecture, such as `aarch64`.
///
/// Networks give the same bits on processors of one class with the same backend.
pub fn cpu_class() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    return x86_64_level();
    #[cfg(not(target_arch = "x86_64"))]
    return std::env::consts::ARCH;
}

/// Returns the highest level of the x86-64 psABI whose instructions the processor supports.
#[cfg(target_arch = "x86_64")]
fn x86_64_level() -> &'static str {
    macro_rules! has {
        ($($feature:tt),+) => { $(std::is_x86_feature_detected!($feature))&&+ };
    }
    if !has!("sse3", "ssse3", "sse4.1", "sse4.2", "popcnt", "cmpxchg16b") {
        "x86_64"
    } else if !has!("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "lzcnt", "movbe") {
        "x86_64-v2"
    } else if !has!("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl") {
        "x86_64-v3"
    } else {
        "x86_64-v4"
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_class_begins_with_the_architecture() {
        assert!(super::cpu_class().starts_with(std::env::consts::ARCH));
    }
}
