//! Available memory.

/// Memory (bytes) assumed for a machine that does not report it.
const ASSUMED_MEMORY: u64 = 8 << 30;

/// Upper bound (bytes) of the memory that this process may allocate. It is the least of the machine's available memory
/// and the limits of container and `ulimit`.
pub fn free() -> u64 {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let field = |text: &str, name: &str| {
        text.lines().find_map(|l| l.strip_prefix(name)?.split_whitespace().next()?.parse::<u64>().ok())
    };
    let machine = field(&read("/proc/meminfo"), "MemAvailable:").map(|kib| kib.saturating_mul(1024));
    let container = read("/sys/fs/cgroup/memory.max").trim().parse().ok();
    let process = field(&read("/proc/self/limits"), "Max address space");
    [machine, container, process].into_iter().flatten().min().unwrap_or(ASSUMED_MEMORY)
}
