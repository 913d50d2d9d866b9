require recipes-kernel/linux/segway-ecc-kernel.inc
