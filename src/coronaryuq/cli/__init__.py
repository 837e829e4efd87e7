"""The console command: checks, explanations and benchmarks."""
