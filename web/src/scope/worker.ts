// The worker of the scope: keeps the samples, and draws.
export {};
