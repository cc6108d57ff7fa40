"""Which change makes the second simulation (Figure 7) settle within the domain of the theory.

    python studies/circle.py

prints the worst of four followers and of the seeds 1 to 10 for each change to ``clmr_circle_as_printed.xml``.
"""

from variation import HEADER, SCENARIOS, gain, heading, outcome, parameter, row, worst

SEEDS = range(1, 11)
SCENARIO = SCENARIOS / "clmr_circle_as_printed.xml"

CHANGES = {
    "none": [],
    "θ_m = 10 (printed: 20; 10 on the line)": gain(theta_m=10),
    "γ_θ = 0.5 (0.25; 0.5 on the line)": gain(gamma_theta=0.5),
    "γ_w = 10 (0.1; 10 on the line)": gain(gamma_w=10),
    "W_m = 1000 (100; 1000 on the line)": gain(W_m=1000),
    "all four of the line": gain(theta_m=10, gamma_theta=0.5, gamma_w=10, W_m=1000),
    "γ_w = 0: no network": gain(gamma_w=0),
    "ε_t = 1 (10)": gain(epsilon_t=1),
    "k_d = 20 (10)": gain(k_d=20),
    "Λ_1 = 0.01 (0.05)": gain(Lambda_1=0.01),
    "Λ_1 = 0.1": gain(Lambda_1=0.1),
    "Λ_1 = 0.2": gain(Lambda_1=0.2),
    "Λ_0 = 1 (2)": gain(Lambda_0=1),
    "Λ_0 = 3": gain(Lambda_0=3),
    "K_p = 20 (10)": gain(K_p=20),
    "K_p = 30": gain(K_p=30),
    "K_p = 50": gain(K_p=50),
    "K_p = 100": gain(K_p=100),
    "**K_p = 150**": gain(K_p=150),
    "K_p = 200": gain(K_p=200),
    "K_p = 50, Λ_0 = 3": gain(K_p=50, Lambda_0=3),
    "front-wheel drive": parameter("drive", "front_wheel"),
    "rear-wheel drive": parameter("drive", "rear_wheel"),
    "rear-wheel drive, K_p = 30": [*parameter("drive", "rear_wheel"), *gain(K_p=30)],
}

if __name__ == "__main__":
    print(heading("change", *HEADER))
    for label, changes in CHANGES.items():
        print(row(label, *worst(outcome(SCENARIO, changes, seed) for seed in SEEDS).cells()), flush=True)
