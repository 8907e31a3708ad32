// Registers of the SAM3X8E that the hardware layer uses, at their addresses and offsets (datasheet Atmel-11057 and
// CMSIS names). Reserved words are written out, so that a wrong name or place is a wrong address in the emulator.
#ifndef SAM3X_H
#define SAM3X_H

#include <stdint.h>

typedef volatile uint32_t RwReg;
typedef volatile uint32_t WoReg;
typedef const volatile uint32_t RoReg;

typedef struct {
  WoReg PIO_PER, PIO_PDR;
  RoReg PIO_PSR, reserved1;
  WoReg PIO_OER, PIO_ODR;
  RoReg PIO_OSR, reserved2;
  WoReg PIO_IFER, PIO_IFDR;
  RoReg PIO_IFSR, reserved3;
  WoReg PIO_SODR, PIO_CODR;
  RwReg PIO_ODSR;
  RoReg PIO_PDSR;
  WoReg PIO_IER, PIO_IDR;
  RoReg PIO_IMR, PIO_ISR;
  WoReg PIO_MDER, PIO_MDDR;
  RoReg PIO_MDSR, reserved4;
  WoReg PIO_PUDR, PIO_PUER;
  RoReg PIO_PUSR, reserved5;
  RwReg PIO_ABSR;
  RoReg reserved6[3];
  WoReg PIO_SCIFSR, PIO_DIFSR;
  RoReg PIO_IFDGSR;
  RwReg PIO_SCDR;
  RoReg reserved7[8];
  WoReg PIO_AIMER, PIO_AIMDR;
} Pio;

typedef struct {
  RwReg TC_CCR, TC_CMR, TC_SMMR;
  RoReg reserved1;
  RwReg TC_CV, TC_RA, TC_RB, TC_RC, TC_SR, TC_IER, TC_IDR, TC_IMR;
  RoReg reserved2[4];
} TcChannel;
typedef struct {
  TcChannel TC_CHANNEL[3];
  WoReg TC_BCR;
  RwReg TC_BMR;
  WoReg TC_QIER, TC_QIDR;
  RoReg TC_QIMR, TC_QISR;
} Tc;

typedef struct {
  RwReg PWM_CMR, PWM_CDTY, PWM_CDTYUPD, PWM_CPRD, PWM_CPRDUPD, PWM_CCNT, PWM_DT, PWM_DTUPD;
} PwmCh_num;
typedef struct {
  RwReg PWM_CLK;
  WoReg PWM_ENA, PWM_DIS;
  RoReg PWM_SR;
  RoReg reserved[124];
  PwmCh_num PWM_CH_NUM[8];
} Pwm;

typedef struct {
  WoReg ADC_CR;
  RwReg ADC_MR, ADC_SEQR1, ADC_SEQR2;
  WoReg ADC_CHER, ADC_CHDR;
  RoReg ADC_CHSR, reserved1, ADC_LCDR;
  RoReg reserved2[11];
  RoReg ADC_CDR[16];
} Adc;

typedef struct {
  WoReg UART_CR;
  RwReg UART_MR;
  WoReg UART_IER, UART_IDR;
  RoReg UART_IMR, UART_SR, UART_RHR;
  WoReg UART_THR;
  RwReg UART_BRGR;
  RoReg reserved1[55];
  RwReg UART_RPR, UART_RCR, UART_TPR, UART_TCR, UART_RNPR, UART_RNCR, UART_TNPR, UART_TNCR;
  WoReg UART_PTCR;
  RoReg UART_PTSR;
} Uart;

typedef struct {
  RoReg reserved1[76];
  RoReg UOTGHS_DEVEPTISR[10];
  RoReg reserved3[2];
  WoReg UOTGHS_DEVEPTICR[10];
  RoReg reserved4[14];
  RoReg UOTGHS_DEVEPTIMR[10];
  RoReg reserved5[14];
  WoReg UOTGHS_DEVEPTIDR[10];
  RoReg reserved6[367];
  RoReg UOTGHS_SR;
} Uotghs;

typedef struct {
  WoReg PMC_SCER, PMC_SCDR;
  RoReg PMC_SCSR, reserved1;
  WoReg PMC_PCER0, PMC_PCDR0;
  RoReg PMC_PCSR0;
  RoReg reserved2[57];
  WoReg PMC_PCER1, PMC_PCDR1;
  RoReg PMC_PCSR1;
} Pmc;

typedef struct {
  RwReg EEFC_FMR;
  WoReg EEFC_FCR;
  RoReg EEFC_FSR;
} Efc;
typedef struct {
  WoReg TRNG_CR;
  RoReg reserved1[6];
  RoReg TRNG_ISR;
  RoReg reserved2[12];
  RoReg TRNG_ODATA;
} Trng;
typedef struct {
  WoReg RSTC_CR;
  RoReg RSTC_SR;
} Rstc;
typedef struct {
  WoReg SUPC_CR;
  RwReg SUPC_SMMR, SUPC_MR, SUPC_WUMR, SUPC_WUIR;
  RoReg SUPC_SR;
} Supc;
typedef struct {
  WoReg WDT_CR;
  RwReg WDT_MR;
  RoReg WDT_SR;
} Wdt;
typedef struct {
  RwReg SYS_GPBR[8];
} Gpbr;

#define TC0 ((Tc*)0x40080000u)
#define TC1 ((Tc*)0x40084000u)
#define TC2 ((Tc*)0x40088000u)
#define PWM ((Pwm*)0x40094000u)
#define UOTGHS ((Uotghs*)0x400AC000u)
#define TRNG ((Trng*)0x400BC000u)
#define ADC ((Adc*)0x400C0000u)
#define PMC ((Pmc*)0x400E0600u)
#define UART ((Uart*)0x400E0800u)
#define EFC0 ((Efc*)0x400E0A00u)
#define PIOA ((Pio*)0x400E0E00u)
#define PIOB ((Pio*)0x400E1000u)
#define PIOC ((Pio*)0x400E1200u)
#define PIOD ((Pio*)0x400E1400u)
#define RSTC ((Rstc*)0x400E1A00u)
#define SUPC ((Supc*)0x400E1A10u)
#define WDT ((Wdt*)0x400E1A50u)
#define GPBR ((Gpbr*)0x400E1A90u)
#define UOTGHS_RAM_ADDR (0x20180000u)
#define IFLASH0_ADDR (0x80000u)

#define ID_UART 8
#define ID_TC0 27
#define ID_TC3 30
#define ID_TC6 33
#define ID_TRNG 41

#define TC_CMR_TCCLKS_TIMER_CLOCK1 (0x0u << 0)
#define TC_CMR_TCCLKS_XC0 (0x5u << 0)
#define TC_CMR_WAVE (0x1u << 15)
#define TC_CMR_WAVSEL_UP_RC (0x2u << 13)
#define TC_BMR_QDEN (0x1u << 8)
#define TC_BMR_POSEN (0x1u << 9)
#define TC_BMR_EDGPHA (0x1u << 12)
#define TC_BMR_FILTER (0x1u << 19)
#define TC_BMR_MAXFILT(value) ((0x3fu << 20) & ((value) << 20))
#define TC_QISR_QERR (0x1u << 2)
#define TC_CCR_CLKEN (0x1u << 0)
#define TC_CCR_CLKDIS (0x1u << 1)
#define TC_CCR_SWTRG (0x1u << 2)
#define TC_IER_CPCS (0x1u << 4)
#define ADC_CR_START (0x1u << 1)
#define PWM_CMR_CPRE_MCK (0x0u << 0)
#define UART_CR_RSTRX (0x1u << 2)
#define UART_CR_RSTTX (0x1u << 3)
#define UART_CR_RXEN (0x1u << 4)
#define UART_CR_RXDIS (0x1u << 5)
#define UART_CR_TXEN (0x1u << 6)
#define UART_CR_TXDIS (0x1u << 7)
#define UART_CR_RSTSTA (0x1u << 8)
#define UART_MR_PAR_NO (0x4u << 9)
#define UART_SR_OVRE (0x1u << 5)
#define UART_PTCR_RXTEN (0x1u << 0)
#define UART_PTCR_RXTDIS (0x1u << 1)
#define UART_PTCR_TXTEN (0x1u << 8)
#define UART_PTCR_TXTDIS (0x1u << 9)
#define UOTGHS_DEVEPTISR_TXINI (0x1u << 0)
#define UOTGHS_DEVEPTISR_RXOUTI (0x1u << 1)
#define UOTGHS_DEVEPTISR_BYCT_Pos 20
#define UOTGHS_DEVEPTISR_BYCT_Msk (0x7ffu << UOTGHS_DEVEPTISR_BYCT_Pos)
#define UOTGHS_DEVEPTICR_TXINIC (0x1u << 0)
#define UOTGHS_DEVEPTICR_RXOUTIC (0x1u << 1)
#define UOTGHS_DEVEPTIMR_RXOUTE (0x1u << 1)
#define UOTGHS_DEVEPTIDR_RXOUTEC (0x1u << 1)
#define UOTGHS_DEVEPTIDR_FIFOCONC (0x1u << 14)
#define UOTGHS_SR_SPEED_Msk (0x3u << 12)
#define UOTGHS_SR_SPEED_HIGH_SPEED (0x1u << 12)
#define EEFC_FMR_SCOD (0x1u << 16)
#define EEFC_FCR_FCMD(value) (0xffu & (value))
#define EEFC_FCR_FKEY(value) ((0xffu << 24) & ((value) << 24))
#define EEFC_FSR_FRDY (0x1u << 0)
#define TRNG_CR_ENABLE (0x1u << 0)
#define TRNG_CR_KEY(value) ((0xffffffu << 8) & ((value) << 8))
#define TRNG_ISR_DATRDY (0x1u << 0)
#define RSTC_SR_RSTTYP_Pos 8
#define RSTC_SR_RSTTYP_Msk (0x7u << RSTC_SR_RSTTYP_Pos)
#define SUPC_SMMR_SMTH_3_0V (0xBu << 0)
#define SUPC_SMMR_SMSMPL_CSM (0x1u << 8)
#define SUPC_SR_BODRSTS (0x1u << 3)
#define SUPC_SR_SMS (0x1u << 5)
#define WDT_CR_WDRSTT (0x1u << 0)
#define WDT_CR_KEY(value) ((0xffu << 24) & ((value) << 24))
#define WDT_MR_WDV(value) (0xfffu & (value))
#define WDT_MR_WDRSTEN (0x1u << 13)
#define WDT_MR_WDD(value) ((0xfffu << 16) & ((value) << 16))

#endif
