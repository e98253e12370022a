//! Launches, captured graphs, copies and products. Needs a graphics card; where there is none it says so and ends.

use criterion::Criterion;
use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Device, DeviceError, Lane, Op, Precision, Replay, ordinal};

/// Adds 1 to every number.
const SOURCE: &str = "extern \"C\" __global__ void add(float* x, int n) {
    int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n) x[i] += 1;
}";
/// Numbers of a copy: 4 MiB.
const NUMBERS: usize = 1 << 20;
/// Launches in a row.
const LAUNCHES: usize = 100;
/// Rows and columns of a product.
const SIZE: usize = 1024;

fn device() -> Result<Device, DeviceError> {
    Device::open(ordinal(), SOURCE, &["add"])?.with_products(Precision::Tf32)
}

fn bench(c: &mut Criterion, device: &Device) -> Result<(), DeviceError> {
    let mut host = vec![1.0f32; NUMBERS];
    let buffer = device.upload(&host)?;
    let launch = || -> Result<(), DeviceError> {
        let blocks = NUMBERS.div_ceil(256);
        (0..LAUNCHES).try_for_each(|_| device.launch("add", (blocks, 1), (256, 1), 0, &[Ptr(buffer.ptr), Int(NUMBERS)]))
    };
    let done = |result: Result<(), DeviceError>| result.and_then(|()| device.wait()).expect("the card works");
    c.bench_function("100 launches", |b| b.iter(|| done(launch())));
    let graph = Replay::<()>::default();
    c.bench_function("100 launches in a graph", |b| b.iter(|| done(graph.run(device, "graph", (), launch))));
    c.bench_function("4 MiB to the card", |b| b.iter(|| done(device.write(&buffer, &host))));
    c.bench_function("4 MiB from the card", |b| b.iter(|| done(device.read(&buffer, &mut host))));
    let [x, y, z] = [device.zeros::<f32>(SIZE * SIZE)?, device.zeros(SIZE * SIZE)?, device.zeros(SIZE * SIZE)?];
    let ops = (Op::Plain, Op::Plain);
    let product = || device.product(Lane::Main, ops, (SIZE, SIZE, SIZE), (x.ptr, SIZE), (y.ptr, SIZE), 0.0, (z.ptr, SIZE));
    c.bench_function("product of 1024 x 1024, TF32", |b| b.iter(|| done(product())));
    Ok(())
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    match device() {
        Ok(device) => bench(&mut criterion, &device).expect("the card works"),
        Err(reason) => println!("skipped, there is no graphics card to measure: {reason}"),
    }
    criterion.final_summary();
}
