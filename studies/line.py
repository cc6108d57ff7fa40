"""Which single change removes the oscillation of the first simulation (Figure 6).

    python studies/line.py

prints the worst of four followers and of the seeds 1 to 10 for each change to ``clmr_line_as_printed.xml``.
"""

from variation import HEADER, SCENARIOS, gain, heading, outcome, row, worst

SEEDS = range(1, 11)
SCENARIO = SCENARIOS / "clmr_line_as_printed.xml"

CHANGES = {
    "none": [],
    "W_m = 200 (printed: 1000)": gain(W_m=200),
    "W_m = 150": gain(W_m=150),
    "**W_m = 100**": gain(W_m=100),
    "γ_w = 5 (10)": gain(gamma_w=5),
    "K_p = 20 (10)": gain(K_p=20),
    "Λ_0 = 1 (2)": gain(Lambda_0=1),
    "ε_t = 1 (10)": gain(epsilon_t=1),
    "θ_m = 20 (10)": gain(theta_m=20),
}

if __name__ == "__main__":
    print(heading("change", *HEADER))
    for label, changes in CHANGES.items():
        print(row(label, *worst(outcome(SCENARIO, changes, seed) for seed in SEEDS).cells()), flush=True)
